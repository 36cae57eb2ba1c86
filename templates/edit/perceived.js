// What perception found in the photo: its verdict and summary in words, and doubtful regions, dashed, over the photo.

import { button, element, part } from "./elements.js";

const INK = "#ffffff",
  DASH = [6, 4], // px of the screen
  NAMES = 12; // regions that are named at once; more names would cover the photo

export function start(editor) {
  let regions = [];

  editor.on("state", ({ state, before }) => {
    regions = (state.doubtful ?? []).map(({ name, text, rings }) => ({ name, text, path: pathOf(rings), top: topOf(rings) }));
    if (!before && state.perceived?.new) show(state.perceived);
    editor.redraw();
  });

  editor.overlay((context, pen) => {
    if (editor.player?.playing) return;
    for (const { path } of regions) pen.stroke(path, INK, 1.4, 0.9, DASH);
    if (regions.length <= NAMES) for (const { text, top } of regions) pen.words(text, ...top, INK, { size: 11 });
  });

  // beside the photo, so that it covers no object
  function show({ verdict, summary }) {
    const close = button("Close", () => card.remove(), { class: "act main" });
    const card = element(
      "section.hint.perceived-card",
      { "aria-labelledby": "perceived-title", "data-part": "perceived" },
      element("h2", { id: "perceived-title" }, "What was found"),
      ...described(verdict, summary),
      element("div.hint-acts", {}, close),
    );
    part("run").prepend(card);
  }
}

// -> elements of a verdict and the lines of a summary
export function described(verdict, summary) {
  const rows = summary.slice(1).map((line) => {
    const [, name, words] = line.match(/^\s*(\S+)\s+(.*)$/) ?? [null, "", line];
    return element("div", {}, element("dt", {}, name), element("dd", {}, words));
  });
  return [element("p.verdict", {}, `Suitability: ${verdict}.`), element("dl.summary", {}, ...rows)];
}

function pathOf(rings) {
  const path = new Path2D();
  for (const ring of rings) {
    ring.forEach(([x, y], k) => (k ? path.lineTo(x, y) : path.moveTo(x, y)));
    path.closePath();
  }
  return path;
}

const topOf = (rings) => rings.flat().reduce((top, point) => (point[1] < top[1] ? point : top));
