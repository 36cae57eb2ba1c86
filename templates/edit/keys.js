// Keys for everything, and the sheet that lists them.

import { button, element, part } from "./elements.js";

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const SHEET = [
  [
    "Objects",
    [
      ["Tab", "from object to object; Enter chooses"],
      ["← ↑ → ↓", "change the chosen push, or move the chosen object"],
      ["Shift ←", "in larger steps"],
      ["[ ]", "spin or turn it"],
      ["x", "pin it, or let it go"],
      ["Delete", "delete it"],
      ["Esc", "stop a drag; choose nothing"],
    ],
  ],
  [
    "Pushing",
    [
      ["drag", "velocity"],
      ["Shift drag", "impulse, where it is pressed"],
      ["Alt drag", "force for 0.2 s"],
      ["ring", "spin; with Alt a torque"],
      ["Alt move", "without what is held to it"],
    ],
  ],
  [
    "Playing",
    [
      ["space", "play, pause"],
      ["r", "play again"],
      [", .", "a frame back, on"],
      ["Home End", "beginning, end"],
      ["{ }", "slower, faster"],
      ["l", "loop"],
      ["q", "this frame in the video's quality"],
    ],
  ],
  [
    "Masks",
    [
      ["1 8", "box to new object"],
      ["[ ]", "size of the brush"],
      ["← ↑ → ↓", "a cursor; with Shift faster"],
      ["space", "press there, let go"],
      ["Enter", "close the outline"],
    ],
  ],
  [
    "The photo",
    [
      ["+ −", "closer, farther"],
      ["0", "all of it"],
      ["← ↑ → ↓", "move it, where nothing is chosen"],
      ["wheel", "closer, farther"],
      ["space drag", "move it"],
      ["Shift letter", "what is drawn; on its button"],
    ],
  ],
  [
    "Everywhere",
    [
      ["Ctrl Z", "undo"],
      ["Ctrl Y", "redo"],
      ["Ctrl S", "save"],
      ["F6", "photo, panels, player"],
      ["?", "this sheet"],
    ],
  ],
];

export function start(editor) {
  let panned = false;
  const over = part("over");
  over.tabIndex = 0;
  over.addEventListener("pointerdown", () => {
    panned = true;
  });

  function sheet() {
    const dialog = element(
      "dialog.keys-sheet",
      { "aria-labelledby": "keys-title" },
      element("h2", { id: "keys-title", tabindex: -1, autofocus: true }, "Keys"),
      element(
        "div.sets",
        {},
        ...[["Tools", [...editor.tools.values()].map((tool) => [tool.key, tool.label])], ...SHEET].map(([name, rows]) =>
          element(
            "section",
            {},
            element("h3", {}, name),
            element(
              "dl",
              {},
              ...rows.flatMap(([key, what]) => [
                element("dt", {}, ...key.split(" ").flatMap((k, n) => [n ? " " : "", element("kbd", {}, k)])),
                element("dd", {}, what),
              ]),
            ),
          ),
        ),
      ),
      element(
        "p.deeds",
        {},
        button("Close", () => dialog.close(), { class: "act main" }),
        button("Show the first steps", () => {
          dialog.close();
          editor.showHint?.();
        }),
      ),
    );
    dialog.addEventListener("close", () => dialog.remove());
    document.body.append(dialog);
    dialog.showModal();
  }
  part("help").addEventListener("click", sheet);

  const regions = [
    [part("stage"), over],
    [document.getElementById("panels"), document.getElementById("panels")],
    [part("run"), part("play")],
  ];
  function nextRegion(by) {
    const at = regions.findIndex(([region]) => region.contains(document.activeElement));
    regions[(at + by + regions.length) % regions.length][1].focus();
  }

  const plain = {
    " ": () => editor.player.toggle(),
    r: () => editor.player.again(),
    ",": () => editor.player.step(-1),
    ".": () => editor.player.step(1),
    l: () => editor.player.loop(),
    q: () => editor.showFinal?.(),
    Home: () => editor.player.rewind(),
    End: () => {
      editor.player.pause();
      editor.player.seek(editor.player.run.end);
    },
    "{": () => editor.player.faster(-1),
    "}": () => editor.player.faster(1),
    "+": () => editor.stage.zoom(1.4),
    "=": () => editor.stage.zoom(1.4),
    "-": () => editor.stage.zoom(1 / 1.4),
    0: () => editor.stage.fit(),
    "?": sheet,
    x: () => editor.acts.pin(),
    Delete: () => editor.acts.erase(),
    Backspace: () => editor.acts.erase(),
    "[": () => editor.tool?.turn?.(-1),
    "]": () => editor.tool?.turn?.(1),
    Enter: () => editor.tool?.enter?.(),
    Escape: () => {
      if (!editor.tool?.cancel?.()) editor.choose(null);
    },
  };

  addEventListener("keydown", async (event) => {
    if (event.defaultPrevented || document.querySelector("dialog[open]")) return;
    const { target, key } = event,
      control = event.ctrlKey || event.metaKey;
    if (key === "F6") {
      nextRegion(event.shiftKey ? -1 : 1);
      event.preventDefault();
      return;
    }
    const writes = target.matches?.("textarea, select, input:not([type=range], [type=checkbox]), [contenteditable=true]");
    if (control && !event.altKey && !writes) {
      const run = { z: event.shiftKey ? "redo" : "undo", y: "redo" }[key.toLowerCase()];
      if (!run) return;
      event.preventDefault();
      await editor.flush?.();
      editor[run]();
      return;
    }
    if (control || writes || !editor.player.run) return;
    const pressed = target.matches?.("button, summary, a, input[type=checkbox]");
    if (pressed && (key === " " || key === "Enter")) return;
    const inPanel = document.getElementById("panels").contains(target) || target.matches?.("input[type=range]");
    if (ARROWS[key]) {
      if (inPanel || target.closest?.("[role=toolbar], [role=tablist]")) return;
      const [dx, dy] = ARROWS[key];
      if (editor.tool?.nudge?.(ARROWS[key], event)) event.preventDefault();
      else if (!editor.selected) {
        editor.stage.pan(-40 * dx, -40 * dy);
        event.preventDefault();
      }
      return;
    }
    if (event.altKey) return;
    if (event.shiftKey && /^[A-Z]$/.test(key)) {
      const chip = part("layers").querySelector(`[aria-keyshortcuts="Shift+${key}"]`);
      if (chip) {
        chip.click();
        event.preventDefault();
      }
      return;
    }
    const tool = [...editor.tools.values()].find((t) => t.key === key),
      run = tool ? () => editor.useTool(tool.name) : plain[key];
    if (!run || (inPanel && (key === "Delete" || key === "Backspace" || key === "Home" || key === "End"))) return;
    if (key === " " && target === over) {
      // on release, unless the photo was moved meanwhile
      panned &&= event.repeat;
      event.preventDefault();
      return;
    }
    event.preventDefault();
    run();
  });
  addEventListener("keyup", (event) => {
    if (event.key === " " && event.target === over && !panned) editor.player.toggle();
  });
}
