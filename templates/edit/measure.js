// The photo's scale by a length that is known: draw it, and say how long it is.

import { button, element, part } from "./elements.js";
import { INKS } from "./stage.js";
import { pixel, point2, setting } from "./dragging.js";

export function start(editor) {
  let line = null,
    drawing = false;
  const number = element("input", { type: "text", inputmode: "decimal", "aria-label": "Its true length", value: "10" });
  const unit = element(
    "select",
    { "aria-label": "Unit" },
    ...[
      ["cm", 0.01],
      ["mm", 0.001],
      ["m", 1],
    ].map(([name, worth]) => element("option", { value: String(worth) }, name)),
  );
  const words = element("p", {}, "Drag along a known length."),
    done = button("Set the scale", set, { class: "act main" });
  const strip = element("div.strip", { hidden: true }, words, number, unit, done);
  part("beside").append(strip);
  const long = () => (line ? Math.hypot(line[1][0] - line[0][0], line[1][1] - line[0][1]) : 0);
  function describe() {
    strip.hidden = editor.tool?.name !== "measure";
    for (const made of [number, unit, done]) made.hidden = long() < 3 || drawing;
    words.textContent = long() < 3 ? "Drag along a known length." : `${long().toFixed(1)} px are`;
  }
  async function set() {
    const meters = Number(number.value.replace(",", ".")) * unit.value,
      wrong = !(meters > 0);
    number.setAttribute("aria-invalid", wrong);
    if (wrong) {
      editor.say("Write its length as a number above 0", "error");
      return;
    }
    const value = +(long() / meters).toPrecision(4);
    await editor.edit(setting(editor, ["world", "pixels_per_meter"], value), `scale: ${value} px are 1 m`).catch(() => {});
    editor.say(`${value} px are 1 m`);
    line = null;
    describe();
    editor.redraw();
  }
  number.addEventListener("keydown", (event) => {
    if (event.key === "Enter") set();
  });
  editor.on("tool", describe);
  editor.registerTool({
    name: "measure",
    label: "Draw a known length",
    short: "Scale",
    key: "d",
    cursor: "crosshair",
    icon: "M2 8h20v8H2zm2 2v4h16v-4h-2v2h-1.5v-2H14v2h-1.5v-2H10v2H8.5v-2H7v2H5.5v-2z",
    down(point) {
      line = [point, point];
      drawing = true;
      describe();
    },
    move(point) {
      if (drawing) {
        line = [line[0], point2(point, pixel(editor))];
        describe();
        editor.redraw();
      }
    },
    up() {
      drawing = false;
      describe();
      if (long() >= 3) {
        number.focus();
        number.select();
      }
    },
    cancel() {
      const had = line;
      line = null;
      drawing = false;
      describe();
      editor.redraw();
      return Boolean(had);
    },
    draw(context, pen) {
      if (!line) return;
      const [a, b] = line,
        far = long() || 1,
        n = [(-(b[1] - a[1]) / far) * 8 * pen.unit, ((b[0] - a[0]) / far) * 8 * pen.unit];
      pen.stroke(lineOf(line), INKS.accent, 2.2);
      for (const [x, y] of line)
        pen.stroke(
          lineOf([
            [x - n[0], y - n[1]],
            [x + n[0], y + n[1]],
          ]),
          INKS.accent,
          2.2,
        );
      pen.words(`${far.toFixed(1)} px`, (a[0] + b[0]) / 2 + 2.4 * n[0], (a[1] + b[1]) / 2 + 2.4 * n[1], "#fff");
    },
  });
}
