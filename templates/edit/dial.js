// Gravity on a dial: the needle's way is its direction, the number its size.

import { makeRepeated, rounded, setting } from "./dragging.js";

const SVG = "http://www.w3.org/2000/svg";
const drawn = (name, attributes) => {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
};

// `gravity` returns the scene's, px/s²; `meter` px
export function makeGravity(editor, gravity, meter) {
  const repeated = makeRepeated(editor);
  function gravityOps([x, y]) {
    const size = Math.hypot(x, y),
      by = size ? 10 ** (Math.floor(Math.log10(size)) - 3) : 1,
      value = [rounded(x, by), rounded(y, by)];
    return setting(editor, ["world", "gravity"], value);
  }
  const setGravity = (vector, tag = null) => {
    const size = Math.hypot(...vector) / meter();
    editor.edit(gravityOps(vector), `gravity ${+size.toPrecision(3)} m/s²`, tag).catch(() => editor.preview(null));
  };
  function makeDial() {
    const svg = drawn("svg", {
      viewBox: "-52 -52 104 104",
      tabindex: 0,
      role: "slider",
      "aria-label": "Direction of gravity, degrees from straight down",
      "aria-valuemin": -180,
      "aria-valuemax": 180,
      "data-part": "dial",
    });
    const needle = drawn("line", { class: "needle", x1: 0, y1: 0, x2: 0, y2: 36 }),
      tip = drawn("circle", { class: "tip", cx: 0, cy: 36, r: 7 });
    svg.append(
      drawn("circle", { class: "rim", r: 47 }),
      ...Array.from({ length: 12 }, (_, k) => drawn("line", { class: "tick", x1: 0, y1: 43, x2: 0, y2: 47, transform: `rotate(${30 * k})` })),
      needle,
      drawn("circle", { class: "globe", r: 3.5 }),
      tip,
    );
    let held = null;
    const show = ([x, y]) => {
      const size = Math.hypot(x, y),
        [ux, uy] = size ? [x / size, y / size] : [0, 0];
      for (const [key, value] of [
        ["x2", 36 * ux],
        ["y2", 36 * uy],
      ])
        needle.setAttribute(key, value);
      for (const [key, value] of [
        ["cx", 36 * ux],
        ["cy", 36 * uy],
      ])
        tip.setAttribute(key, value);
      const angle = Math.round((Math.atan2(-x, y) * 180) / Math.PI);
      svg.setAttribute("aria-valuenow", size ? angle : 0);
      svg.setAttribute(
        "aria-valuetext",
        size ? `${angle} degrees from straight down, ${+(size / meter()).toPrecision(3)} metres per second squared` : "no gravity",
      );
    };
    const pointed = (event) => {
      const box = svg.getBoundingClientRect(),
        x = event.clientX - box.left - box.width / 2,
        y = event.clientY - box.top - box.height / 2;
      let angle = Math.round((Math.atan2(y, x) * 180) / Math.PI);
      if (Math.abs(((angle + 405) % 90) - 45) < 5) angle = 90 * Math.round(angle / 90);
      const size = Math.hypot(...gravity()) || 9.8 * meter(),
        a = (angle * Math.PI) / 180;
      return [size * Math.cos(a), size * Math.sin(a)].map((v) => (Math.abs(v) < 1e-9 * size ? 0 : v));
    };
    svg.addEventListener("pointerdown", (event) => {
      svg.setPointerCapture(event.pointerId);
      held = pointed(event);
      show(held);
      editor.preview(gravityOps(held));
      svg.focus();
      event.preventDefault();
    });
    svg.addEventListener("pointermove", (event) => {
      if (held) {
        held = pointed(event);
        show(held);
        editor.preview(gravityOps(held));
      }
    });
    svg.addEventListener("pointerup", () => {
      if (held) setGravity(held);
      held = null;
    });
    svg.addEventListener("pointercancel", () => {
      held = null;
      editor.preview(null);
      show(gravity());
    });
    svg.addEventListener("keydown", (event) => {
      const by = { ArrowRight: -5, ArrowDown: -5, ArrowLeft: 5, ArrowUp: 5 }[event.key];
      if (!by) return;
      repeated("gravity", [by], ([turn]) => {
        const [x, y] = gravity(),
          size = Math.hypot(x, y) || 9.8 * meter(),
          a = ((Math.round((Math.atan2(y, x) * 36) / Math.PI) * 5 + turn) * Math.PI) / 180;
        return {
          ops: gravityOps([size * Math.cos(a), size * Math.sin(a)].map((v) => (Math.abs(v) < 1e-9 * size ? 0 : v))),
          what: "gravity turned",
          tag: "gravity",
        };
      });
      event.preventDefault();
      event.stopPropagation();
    });
    return { svg, fill: () => show(gravity()) };
  }
  return { set: setGravity, makeDial };
}
