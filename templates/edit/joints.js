// Pins, springs, welds and motors between objects, or between an object and the world; winds and points that attract.

import { element, part } from "./elements.js";
import { INKS } from "./stage.js";
import { pixel, point2, roundAbove, rounded } from "./dragging.js";

const HOLDS = [
  ["pivot", "Pin"],
  ["spring", "Spring"],
  ["weld", "Weld"],
  ["motor", "Motor"],
  ["slider", "Slider"],
  ["rope", "Rope"],
];
const HINTS = {
  spring: "Drag from an object to where the spring ends, or click both ends.",
  slider: "Drag from an object along its rail, or click both ends of the rail.",
  rope: "Click the two objects that the rope ties, or an object and a fixed point; dragging does the same.",
};
const SAG = 20; // px by which a weight stretches its spring

export function start(editor) {
  let hold = "pivot",
    field = "wind",
    line = null,
    begun = false; // whether a click set the first end of a line
  const stage = () => editor.stage,
    objects = () => editor.state.scene.objects || {};
  const mass = (name) => editor.state.derived.objects[name]?.mass || 1,
    meter = () => editor.state.derived.pixels_per_meter;
  const under = (point, but) => {
    const found = stage().hit(point, { kinds: ["object"] });
    return found && found.name !== but ? found.name : null;
  };
  // everything that holds a point, what is drawn over the others first
  const all = (point) => {
    const rings = Object.keys(objects()).filter((name) =>
      stage()
        .ringsOf(name)
        .some((ring) => inside(ring, point)),
    );
    return rings.sort((a, b) => (objects()[b].layer || 0) - (objects()[a].layer || 0) || mass(a) - mass(b));
  };
  const inside = (ring, [x, y]) => {
    let odd = false;
    for (let k = 0, j = ring.length - 1; k < ring.length; j = k, k += 1)
      if (ring[k][1] > y !== ring[j][1] > y && x < ((ring[j][0] - ring[k][0]) * (y - ring[k][1])) / (ring[j][1] - ring[k][1]) + ring[k][0])
        odd = !odd;
    return odd;
  };

  const choice = (label, rows, chosen, choose) => {
    const strip = element(
      "div.strip",
      { role: "group", "aria-label": label, hidden: true },
      ...rows.map(([value, name]) =>
        element(
          "button.chip",
          {
            type: "button",
            "data-value": value,
            "aria-pressed": value === chosen,
            on: {
              click: () => {
                choose(value);
                for (const made of strip.querySelectorAll("button")) made.setAttribute("aria-pressed", made.dataset.value === value);
                describe();
              },
            },
          },
          name,
        ),
      ),
      element("p", {}),
    );
    part("beside").append(strip);
    return strip;
  };
  const held = choice("What is made", HOLDS, hold, (value) => {
    hold = value;
    line = null;
    begun = false;
    editor.redraw();
  });
  const blown = choice(
    "What is made",
    [
      ["wind", "Wind"],
      ["attractor", "Attractor"],
    ],
    field,
    (value) => {
      field = value;
    },
  );
  function describe() {
    held.hidden = editor.tool?.name !== "joint";
    blown.hidden = editor.tool?.name !== "field";
    held.querySelector("p").textContent = HINTS[hold] || "Click where the joint is: it connects the two objects there, or one and the world.";
    blown.querySelector("p").textContent = field === "wind" ? "Drag in the direction of the wind." : "Click the point that attracts.";
  }
  editor.on("tool", describe);

  async function made(kind, wanted, value) {
    const name = editor.freeName(kind, wanted);
    try {
      await editor.edit([{ add: [kind, name], value }], `${name} made`);
      editor.choose({ kind: kind === "joints" ? "joint" : "field", name });
      editor.showPanel("object");
      editor.say(`${name} made`);
    } catch {
      editor.preview(null);
    }
  }
  const tool = (name, label, short, key, icon, ended) =>
    editor.registerTool({
      name,
      label,
      short,
      key,
      icon,
      cursor: "crosshair",
      down(point) {
        editor.player.rewind();
        line = [begun ? line[0] : point, point];
        editor.redraw();
      },
      move(point) {
        if (line) {
          line = [line[0], point];
          editor.redraw();
        }
      },
      up(point) {
        if (!line) return;
        const [from] = line,
          clicked = Math.hypot(point[0] - from[0], point[1] - from[1]) < 6 * stage().unit;
        if (name === "joint" && HINTS[hold] && clicked && !begun && all(from).length) {
          begun = true;
          editor.say(`Now click where the ${hold} ends; Esc cancels`);
          return;
        }
        line = null;
        begun = false;
        editor.redraw();
        ended(from, point);
      },
      cancel() {
        const had = line;
        line = null;
        begun = false;
        editor.redraw();
        return Boolean(had);
      },
      draw(context, pen) {
        if (!line) return;
        const [a, b] = line;
        if (name === "field" && field === "wind") pen.arrow(a[0], a[1], b[0] - a[0], b[1] - a[1], INKS.field, 1, 3);
        else if (name === "joint") {
          if (HINTS[hold]) pen.stroke(lineOf(line), INKS.joint, 2.4, 1, [5, 4]);
          const dot = new Path2D();
          dot.arc(a[0], a[1], 5 * pen.unit, 0, 2 * Math.PI);
          pen.stroke(dot, INKS.joint, 2);
        }
      },
    });

  tool(
    "joint",
    "Make a joint",
    "Joint",
    "j",
    "M6 3a4 4 0 0 1 3.9 3.1h4.2A4 4 0 1 1 18 11a4 4 0 0 1-2.6-1l-4.8 4.8a4 4 0 1 1-1.4-1.4L14 8.6V8h-4A4 4 0 1 1 6 3z",
    (from, to) => {
      const by = pixel(editor),
        [first, below] = all(from);
      if (!first) {
        editor.say("Begin on an object: a joint connects one or two");
        return;
      }
      if (HINTS[hold]) {
        if (Math.hypot(to[0] - from[0], to[1] - from[1]) < 6 * stage().unit) {
          editor.say(`Drag from an object to where the ${hold} ends`);
          return;
        }
        if (hold !== "spring") {
          const other = hold === "rope" && under(to, first);
          made("joints", hold, { objects: other ? [first, other] : [first], [hold]: [point2(from, by), point2(to, by)] });
          return;
        }
        const second = under(to, first),
          weight = mass(first) * 9.8 * meter(),
          stiffness = +(weight / SAG).toPrecision(1);
        made("joints", "spring", {
          objects: second ? [first, second] : [first],
          spring: [point2(from, by), point2(to, by)],
          stiffness,
          damping: +(0.2 * Math.sqrt(stiffness * mass(first))).toPrecision(1),
        });
        return;
      }
      const second = under(to, first) || below;
      made("joints", { pivot: "pin", weld: "weld", motor: "motor" }[hold], {
        objects: second ? [first, second] : [first],
        [hold]: point2(from, by),
        ...(hold === "motor" ? { speed: 360 } : {}),
      });
    },
  );
  tool(
    "field",
    "Add wind or an attractor",
    "Field",
    "f",
    "M3 8h10a2.5 2.5 0 1 0-2.5-2.5H8.5A4.5 4.5 0 1 1 13 10H3zm0 3.5h14.5a3.5 3.5 0 1 1-3.5 3.5h2a1.5 1.5 0 1 0 1.5-1.5H3zm0 4h7a3 3 0 1 1-3 3h2a1 1 0 1 0 1-1H3z",
    (from, to) => {
      const large = Math.max(...stage().size()),
        g = 9.8 * meter();
      if (field === "attractor") {
        made("fields", "attractor", { attractor: point2(to, pixel(editor)), strength: +(g * (0.3 * large) ** 2).toPrecision(1), soften: 20 });
        return;
      }
      const vector = [to[0] - from[0], to[1] - from[1]],
        far = Math.hypot(...vector);
      if (far < 6 * stage().unit) {
        editor.say("Drag in the direction of the wind");
        return;
      }
      // as far as a fall of that height is fast; and so strong that it pushes a middling object with its weight
      const speed = Math.sqrt(2 * g * far),
        by = roundAbove(speed / 40),
        wind = vector.map((v) => rounded((v / far) * speed, by));
      const items = Object.keys(objects()).sort((a, b) => mass(a) - mass(b)),
        middle = items[items.length >> 1];
      const wide = 2 * (editor.state.derived.objects[middle]?.reach || 20);
      made("fields", "wind", { wind, drag: middle ? +((mass(middle) * g) / (wide * speed ** 2)).toPrecision(1) : 0.001 });
    },
  );
}
