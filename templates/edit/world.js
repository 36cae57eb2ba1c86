// The panel of the world: gravity, the view and the photo's scale, time, and the light's numbers.

import { button, element, part } from "./elements.js";
import { makeGravity } from "./dial.js";
import { setting, written } from "./dragging.js";
import { loadSchema, makeRow } from "./fields.js";

const PLANETS = [
  ["Earth", 9.8],
  ["Moon", 1.62],
  ["Mars", 3.72],
  ["none", 0],
];

export function start(editor) {
  const body = element("div.sheet", {});
  let rows = [],
    shown = "",
    dial = null;
  editor.addPanel({ id: "world", title: "World", element: body, order: 20 });
  const world = () => editor.state?.scene?.world || {},
    meter = () => editor.state?.derived?.pixels_per_meter || 100;
  const gravity = () => world().gravity || (world().view === "top" ? [0, 0] : [0, 9.8 * meter()]);
  const pull = makeGravity(editor, gravity, meter);
  const row = (path, name, options) => {
    const made = makeRow(editor, path, name, options);
    rows.push(made);
    return made.row;
  };

  const form = () => (editor.state?.scene ? `${world().view} ${Boolean(editor.state.scene.light)}` : "none");
  function show() {
    if (form() === shown) {
      dial?.fill();
      rows.forEach((made) => made.fill());
      return;
    }
    shown = form();
    rows = [];
    if (!editor.state?.scene) {
      body.replaceChildren(element("p.empty", {}, "The scene file has errors."));
      return;
    }
    dial = pull.makeDial();
    dial.fill();
    const top = world().view === "top",
      pulled = written(editor, ["world", "gravity"]), // from above nothing falls, unless the file says so
      heading = (text) => element("h3", {}, text),
      light = editor.state.scene.light;
    body.replaceChildren(
      element("h2", {}, "World"),
      ...(top && !pulled ? [] : [heading("Gravity")]),
      top ? "" : element(
        "div.dial",
        {},
        dial.svg,
        element(
          "div.deeds",
          {},
          ...PLANETS.map(([name, g]) =>
            button(
              name,
              () => {
                const [x, y] = gravity(),
                  size = Math.hypot(x, y),
                  down = size ? [x / size, y / size] : [0, 1];
                pull.set(down.map((v) => v * g * meter()));
              },
              { title: `${g} m/s²` },
            ),
          ),
        ),
      ),
      top && !pulled ? "" : row(["world", "gravity"], "x, y", { get: gravity, called: "gravity", says: (v) => `${+(Math.hypot(...v) / meter()).toPrecision(3)} m/s²` }),
      heading("View and scale"),
      row(["world", "view"], "view", {
        kind: "choice",
        choices: [
          { value: "side", name: "from the side" },
          { value: "top", name: "from above" },
        ],
        edits: (value) => {
          editor.say("Finding what holds the objects …");
          return setting(editor, ["world", "view"], value);
        },
      }),
      ...(top
        ? [row(["world", "table", "friction"], "table friction")]
        : [row(["world", "tilt"], "tilt", { step: 1 }), row(["world", "backdrop"], "backdrop")]),
      row(["world", "pixels_per_meter"], "scale", { says: () => `the photo is ${+(editor.stage.size()[0] / meter()).toPrecision(3)} m wide` }),
      element(
        "div.deeds",
        {},
        button("Draw a known length", () => {
          editor.useTool("measure");
          part("over").focus();
        }),
      ),
      heading("Time"),
      row(["world", "duration"], "duration", { step: 0.1, says: () => (/duration:\s*auto/.test(editor.state.text) ? "auto: until all rests, at most this long" : "") }),
      row(["world", "combine"], "pairs", {
        kind: "choice",
        choices: [
          { value: "geometric", name: "geometric mean" },
          { value: "multiply", name: "product" },
        ],
      }),
      row(["world", "steps_per_second"], "steps"),
      heading("Light"),
      ...(light
        ? [
            row(["light", "direction"], "direction", { required: true }),
            row(["light", "intensity"], "intensity", { step: 0.05 }),
            row(["light", "ambient"], "ambient", { step: 0.05 }),
            row(["light", "softness"], "softness", { step: 1 }),
          ]
        : [element("p.empty", {}, "No light set. Drag the sphere on the photo to set one.")]),
    );
  }
  // what holds the objects was found anew: the deed says what
  editor.on("state", ({ state, before }) => {
    const views = [before, state].map((one) => one?.scene?.world.view);
    if (views.every(Boolean) && views[0] !== views[1] && state.undo) editor.say(state.undo);
  });
  loadSchema().then(() => {
    editor.on("state", show);
    if (editor.state) show();
  });
}
