// The things on the stage as a list of buttons, for keyboards and screen readers.

import { element, part } from "./elements.js";
import { same } from "./app.js";

export function start(editor) {
  let listed = "";
  function things() {
    const { scene: there } = editor.state,
      list = part("things"),
      focused = document.activeElement?.dataset?.thing;
    if (!there) return;
    const rows = [
      ...Object.entries(there.objects || {}).map(([name, o]) => ({
        kind: "object",
        name,
        told: [o.label, typeof o.motion === "string" && o.motion !== "dynamic" ? o.motion : ""],
      })),
      ...Object.entries(there.boundaries || {}).map(([name]) => ({ kind: "boundary", name, told: ["boundary"] })),
      ...(there.forces || []).map((f, name) => ({ kind: "force", name, told: [`push on ${f.object}`] })),
      ...Object.entries(there.joints || {}).map(([name]) => ({ kind: "joint", name, told: ["joint"] })),
      ...Object.entries(there.fields || {}).map(([name, f]) => ({ kind: "field", name, told: [f.wind ? "wind" : "attractor"] })),
    ];
    const now = JSON.stringify(rows);
    if (now === listed) return; // who is in the list stays where they are
    listed = now;
    list.replaceChildren(
      ...rows.map(({ kind, name, told }) => {
        const thing = { kind, name },
          words = [kind === "force" ? null : name, ...told].filter(Boolean).join(", ");
        return element(
          "li",
          {},
          element(
            "button",
            {
              type: "button",
              "data-thing": `${kind}:${name}`,
              "aria-pressed": same(editor.selected, thing),
              on: {
                click: () => {
                  editor.choose(thing);
                  editor.showPanel("object");
                },
                focus: () => {
                  editor.stage.hover(thing);
                },
                blur: () => editor.stage.hover(null),
              },
            },
            words,
          ),
        );
      }),
    );
    if (focused) list.querySelector(`[data-thing="${CSS.escape(focused)}"]`)?.focus();
  }
  editor.on("select", (thing) => {
    for (const made of part("things").querySelectorAll("button"))
      made.setAttribute("aria-pressed", thing !== null && made.dataset.thing === `${thing.kind}:${thing.name}`);
  });
  editor.on("state", things);
}
