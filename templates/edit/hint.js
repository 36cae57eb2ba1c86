// Three steps for who is here the first time; gone for good when they are closed, and back by a key.

import { element, part } from "./elements.js";

const KEPT = "physgen-edit-hint";
const YEARS = 10 * 365 * 86400; // s
const STEPS = [
  ["Push", "Drag from an object: the arrow is its velocity, and its simulated motion shows at once."],
  ["Correct", "To do lists uncertain values. Click an object to change its material; Mask corrects its pixels."],
  ["Save", "Undo takes back any edit. Save writes the YAML file; Render makes the video."],
];

export function start(editor) {
  let card = null;

  function show() {
    if (card) return;
    let step = 0;
    const title = element("h2", { id: "hint-title" }), words = element("p"), dots = element("p", { class: "hint-dots" });
    const next = element("button", { type: "button", class: "act main", on: { click: () => { step += 1; if (step < STEPS.length) drawn(); else close(); } } });
    const back = element("button", { type: "button", class: "act plain", on: { click: () => { step -= 1; drawn(); } } }, "Back");
    const skip = element("button", { type: "button", class: "act plain", on: { click: close } }, "Skip");
    card = element("section", { class: "hint", "aria-labelledby": "hint-title", "data-part": "hint" }, dots, title, element("div", { "aria-live": "polite" }, words), element("div", { class: "hint-acts" }, skip, back, next));
    function drawn() {
      dots.textContent = `${step + 1} of ${STEPS.length}`;
      title.textContent = STEPS[step][0];
      words.textContent = STEPS[step][1];
      back.hidden = step === 0;
      skip.hidden = step === STEPS.length - 1;
      next.textContent = step === STEPS.length - 1 ? "Begin" : "Next";
      card.dataset.step = String(step + 1);
    }
    drawn();
    part("stage").append(card); // over the canvas: nothing moves when it goes
  }

  function close() {
    const held = card?.contains(document.activeElement);
    card?.remove();
    card = null;
    try { localStorage.setItem(KEPT, "seen"); } catch { /* a browser that keeps nothing */ }
    document.cookie = `${KEPT}=seen; max-age=${YEARS}; path=/; samesite=strict`; // the next editor has another port, and a store of its own
    if (held) part("stage").focus({ preventScroll: true });
  }

  addEventListener("keydown", (event) => {
    if (event.key !== "Escape" || !card || document.querySelector("dialog[open]")) return;
    close();
    event.stopImmediatePropagation();
  }, true);

  let seen = false;
  try { seen = localStorage.getItem(KEPT) !== null; } catch { /* a browser that keeps nothing */ }
  seen ||= document.cookie.includes(`${KEPT}=seen`);
  editor.on("state", ({ before }) => { if (!before && !seen) show(); });
  editor.showHint = show;
}
