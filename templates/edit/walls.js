// Boundaries: draw one from point to point, drag its ends, its edges or all of it; and grips for whatever else has points.

import { element, part } from "./elements.js";
import { INKS } from "./stage.js";
import { named, pathOf } from "./app.js";
import { pixel, point2 } from "./dragging.js";

const GRIP = 6;
// keys of objects that hold points, and whether they hold one point or a list
const POINTS = {
  boundary: { segment: 2, polyline: 2 },
  joint: { spring: 2, slider: 2, rope: 2, pulley: 4, pivot: 1, weld: 1, motor: 1 },
  field: { attractor: 1 },
  force: { at: 1 },
};

export function start(editor) {
  let drawn = [],
    at = null,
    pressed = null;
  const stage = () => editor.stage;

  // ---- grips: the points of the chosen object
  function pointed(entry) {
    const item = entry && named(entry),
      key = item && Object.keys(POINTS[entry.kind] || {}).find((k) => item[k]);
    return key ? { key, list: POINTS[entry.kind][key] === 2, points: POINTS[entry.kind][key] === 2 ? item[key] : [item[key]] } : null;
  }
  const set = (entry, { key, list }, points) => {
    const base = pathOf(entry),
      ops = [{ set: [...base, key], value: list ? points : points[0] }];
    if (entry.kind === "boundary" && !editor.variant && typeof named(entry).from === "string") ops.push({ unset: [...base, "from"] });
    return ops;
  };
  const closed = ({ points }) => points.length > 3 && points[0].every((v, k) => v === points.at(-1)[k]);
  const snapped = (point, [x, y]) => [
    Math.abs(point[0] - x) < 5 * stage().unit ? x : point[0],
    Math.abs(point[1] - y) < 5 * stage().unit ? y : point[1],
  ];
  const describe = (entry) => (entry.kind === "force" ? "where the push acts" : entry.name);

  editor.grips = {
    at(point, finger = false) {
      const entry = editor.selected,
        own = pointed(entry);
      if (!own) return null;
      const near = (finger ? 3 : 1.8) * GRIP * stage().unit,
        k = own.points.findIndex(([x, y]) => Math.hypot(x - point[0], y - point[1]) < near);
      if (k < 0) return null;
      return {
        drag: () => ({
          to(to) {
            const points = own.points.map((p) => [...p]),
              beside = points[k - 1] || points[k + 1];
            points[k] = point2(beside ? snapped(to, beside) : to, pixel(editor));
            if (closed(own) && (k === 0 || k === points.length - 1)) points[0] = points[points.length - 1] = points[k];
            return set(entry, own, points);
          },
          describe: () => `${describe(entry)} moved`,
        }),
      };
    },
    whole(entry, point) {
      const own = pointed(entry);
      return (
        own && {
          to: (to) =>
            set(
              entry,
              own,
              own.points.map(([x, y]) => point2([x + to[0] - point[0], y + to[1] - point[1]], pixel(editor))),
            ),
          describe: () => `${describe(entry)} moved`,
        }
      );
    },
    shifted(entry, dx, dy) {
      const own = pointed(entry);
      return (
        own &&
        set(
          entry,
          own,
          own.points.map(([x, y]) => point2([x + dx, y + dy], pixel(editor))),
        )
      );
    },
    draw(context, pen) {
      const own = pointed(editor.selected);
      if (own) for (const [x, y] of own.points) grip(pen, x, y);
    },
  };
  function grip(pen, x, y, ink = INKS.accent) {
    const path = new Path2D();
    path.arc(x, y, GRIP * pen.unit, 0, 2 * Math.PI);
    pen.stroke(path, "#fff", 1.6);
    pen.fill(path, ink);
  }

  // ---- drawing: press and drag for one segment; click from point to point for a chain
  const hint = element("p", {}),
    finish = element("button", { type: "button", class: "act main", on: { click: () => made() } }, "Finish");
  const strip = element("div", { class: "strip", hidden: true }, hint, finish);
  part("beside").append(strip);
  function describeTool() {
    strip.hidden = editor.tool?.name !== "wall";
    finish.hidden = drawn.length < 2;
    hint.textContent = drawn.length
      ? "Click on for a chain; Enter or a double click ends it, Esc cancels."
      : "Drag for one wall, or click from point to point.";
  }
  editor.on("tool", describeTool);

  const near = (point, event) => {
    const last = drawn.at(-1),
      first = drawn[0];
    if (drawn.length > 2 && Math.hypot(point[0] - first[0], point[1] - first[1]) < 10 * stage().unit) return first;
    let to = last ? snapped(point, last) : point;
    if (event?.shiftKey && last) {
      const a = Math.round(Math.atan2(to[1] - last[1], to[0] - last[0]) / (Math.PI / 12)) * (Math.PI / 12),
        r = Math.hypot(to[0] - last[0], to[1] - last[1]);
      to = [last[0] + r * Math.cos(a), last[1] + r * Math.sin(a)];
    }
    return point2(to, pixel(editor));
  };
  function freeName(kind, wanted) {
    const all = editor.state.scene[kind] || {};
    for (let k = 1; ; k += 1) {
      const name = k === 1 ? wanted : `${wanted}-${k}`;
      if (!(name in all)) return name;
    }
  }
  editor.freeName = freeName;
  const ops = (points) => {
    const level = points.length === 2 && Math.abs(points[0][1] - points[1][1]) < 0.2 * Math.abs(points[0][0] - points[1][0]);
    const name = freeName("boundaries", level ? "floor" : "wall");
    return { name, list: [{ add: ["boundaries", name], value: points.length === 2 ? { segment: points } : { polyline: points } }] };
  };
  async function made() {
    const points = drawn;
    drawn = [];
    at = null;
    describeTool();
    if (points.length < 2) {
      editor.preview(null);
      editor.redraw();
      return;
    }
    const { name, list } = ops(points);
    try {
      await editor.edit(list, `${name} drawn`);
      editor.choose({ kind: "boundary", name });
      editor.showPanel("object");
      editor.say(`${name} drawn`);
    } catch {
      editor.preview(null);
    }
  }
  editor.registerTool({
    name: "wall",
    label: "Draw a boundary",
    short: "Wall",
    key: "b",
    icon: "M3 17.5 9 7l5 7 4.5-9 1.8 1-5.9 12L9.2 10.7 4.7 18.5z",
    cursor: "crosshair",
    down(point, event) {
      if (drawn.length && event.detail > 1) return;
      const to = near(point, event);
      if (!drawn.length) drawn = [to];
      else if (Math.hypot(to[0] - drawn.at(-1)[0], to[1] - drawn.at(-1)[1]) > 1) drawn.push(to);
      pressed = to;
      at = to;
      if (drawn.length > 3 && to === drawn[0]) made();
      describeTool();
    },
    move(point, event) {
      if (!drawn.length) return;
      at = near(point, event);
      if (Math.hypot(at[0] - drawn.at(-1)[0], at[1] - drawn.at(-1)[1]) > 2) editor.preview(ops([...drawn, at]).list);
      editor.redraw();
    },
    up(point, event) {
      const to = near(point, event);
      if (drawn.length === 1 && pressed && Math.hypot(to[0] - pressed[0], to[1] - pressed[1]) > 8 * stage().unit) {
        drawn.push(to);
        made();
      }
      pressed = null;
    },
    double() {
      if (drawn.length > 1) made();
    },
    enter() {
      if (drawn.length < 2) return false;
      made();
      return true;
    },
    cancel() {
      if (!drawn.length) return false;
      drawn = [];
      at = null;
      editor.preview(null);
      describeTool();
      editor.redraw();
      return true;
    },
    draw(context, pen) {
      if (!drawn.length) return;
      const points = at ? [...drawn, at] : drawn;
      if (points.length > 1) pen.stroke(lineOf(points), INKS.wall, 3);
      for (const [x, y] of points) grip(pen, x, y, INKS.wall);
      if (at) {
        const [a, b] = [drawn.at(-1), at],
          far = Math.hypot(b[0] - a[0], b[1] - a[1]),
          meter = editor.state.derived?.pixels_per_meter;
        if (far > 4)
          pen.words(
            `${Math.round(far)} px${meter ? ` · ${+(far / meter).toPrecision(3)} m` : ""}`,
            (a[0] + b[0]) / 2,
            (a[1] + b[1]) / 2 - 16 * pen.unit,
            "#fff",
          );
      }
    },
  });
}
