// The objects on the stage as a list of buttons, for keyboards and screen readers.

import { element, part } from "./elements.js";
import { same } from "./app.js";

export function start(editor) {
  let listed = "";
  function update() {
    const { scene: there } = editor.state,
      list = part("entries"),
      focused = document.activeElement?.dataset?.entry;
    if (!there) return;
    const rows = [
      ...Object.entries(there.objects || {}).map(([name, o]) => ({
        kind: "object",
        name,
        details: [o.label, typeof o.motion === "string" && o.motion !== "dynamic" ? o.motion : ""],
      })),
      ...Object.entries(there.boundaries || {}).map(([name]) => ({ kind: "boundary", name, details: ["boundary"] })),
      ...(there.forces || []).map((f, name) => ({ kind: "force", name, details: [`push on ${f.object}`] })),
      ...Object.entries(there.joints || {}).map(([name]) => ({ kind: "joint", name, details: ["joint"] })),
      ...Object.entries(there.fields || {}).map(([name, f]) => ({ kind: "field", name, details: [["wind", "air", "water", "magnet", "attractor"].find((key) => f[key])] })),
    ];
    const now = JSON.stringify(rows);
    if (now === listed) return; // who is in the list stays where they are
    listed = now;
    list.replaceChildren(
      ...rows.map(({ kind, name, details }) => {
        const entry = { kind, name },
          words = [kind === "force" ? null : name, ...details].filter(Boolean).join(", ");
        return element(
          "li",
          {},
          element(
            "button",
            {
              type: "button",
              "data-entry": `${kind}:${name}`,
              "aria-pressed": same(editor.selected, entry),
              on: {
                click: () => {
                  editor.choose(entry);
                  editor.showPanel("object");
                },
                focus: () => {
                  editor.stage.hover(entry);
                },
                blur: () => editor.stage.hover(null),
              },
            },
            words,
          ),
        );
      }),
    );
    if (focused) list.querySelector(`[data-entry="${CSS.escape(focused)}"]`)?.focus();
  }
  editor.on("select", (entry) => {
    for (const made of part("entries").querySelectorAll("button"))
      made.setAttribute("aria-pressed", entry !== null && made.dataset.entry === `${entry.kind}:${entry.name}`);
  });
  editor.on("state", update);
}
