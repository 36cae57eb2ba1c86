// The frame that is shown, in the quality of the video: drawn by the server, over the canvas until anything changes.

import { picture } from "./api.js";
import { element, icon, part } from "./elements.js";

const ICON = "M4 5h16v14H4zm2 2v8.6l3.5-3.5 3 3L16 11.6l2 2V7zm2.5 1.5a1.5 1.5 0 1 1 0 3 1.5 1.5 0 0 1 0-3z";

export function start(editor) {
  const shown = element("img.final", { "data-part": "final", alt: "This frame in the quality of the video", hidden: true });
  const button = element("button.round", { type: "button", "data-part": "quality", "aria-pressed": false, "aria-label": "This frame in the video's quality",
    title: "This frame in the quality of the video (q)", "aria-keyshortcuts": "q" }, icon(ICON));
  part("scene").after(shown);
  part("loop").after(button);
  let wanted = 0; // counts what was asked for: a late answer is not shown

  function place() {
    const canvas = part("scene");
    for (const key of ["width", "height", "transform"]) shown.style[key] = canvas.style[key];
  }
  function hide() {
    wanted += 1;
    if (shown.hidden) return;
    shown.hidden = true;
    button.setAttribute("aria-pressed", "false");
    URL.revokeObjectURL(shown.src);
  }
  async function show() {
    if (!shown.hidden) { hide(); return; }
    const { player, state } = editor, { run } = player;
    if (!run || player.trying || !state.picture) { editor.say("The scene is not ready yet"); return; }
    player.pause();
    const asked = (wanted += 1), number = Math.round(run.clip.frameAt(player.time));
    editor.say("Drawing the frame in the video's quality, without noise …");
    try {
      const source = await picture(`/api/frame/${state.picture}?motion=${run.data.key}&number=${number}`);
      if (asked !== wanted) { URL.revokeObjectURL(source); return; }
      shown.src = source;
      await shown.decode();
      if (asked !== wanted) return;
      place();
      shown.hidden = false;
      button.setAttribute("aria-pressed", "true");
      editor.say(`Frame ${number + 1} in the video's quality; it goes when anything changes`);
    } catch (refused) {
      if (asked === wanted) editor.say(refused.message, "error");
    }
  }
  button.addEventListener("click", show);
  editor.on("view", place);
  for (const event of ["time", "preview", "motion"]) editor.on(event, hide);
  editor.showFinal = show;
}
