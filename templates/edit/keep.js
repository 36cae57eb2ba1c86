// What is saved and what is kept only as a draft, a server that went away, a file that another program changed: in words
// under the bar; asked only where both sides changed the file.

import { ask } from "./dialogs.js";
import { element, part } from "./elements.js";

export function start(editor) {
  const bar = element("div", { class: "banners", "aria-label": "Messages", role: "region" });
  document.querySelector("header.bar").after(bar);
  const save = part("save"), saved = part("saved"), banners = new Map();
  const closed = new Set();
  let up = true, asking = false;
  saved.removeAttribute("role"); // it changes with each edit: what matters is announced once, by banners and by saving

  // ---- banners: one a matter
  function banner(id, words, acts = [], { kind = "note", closes = true } = {}) {
    if (words === null) { banners.get(id)?.remove(); banners.delete(id); return; }
    if (closed.has(`${id} ${words}`)) return;
    const made = element("div", { class: `banner ${kind}`, "data-banner": id, role: kind === "bad" ? "alert" : "status" },
      element("p", {}, words),
      element("div", { class: "banner-acts" }, ...acts.map(([label, run]) => element("button", { type: "button", class: "act", on: { click: run } }, label)),
        closes ? element("button", { type: "button", class: "act plain", on: { click: () => { closed.add(`${id} ${words}`); banner(id, null); } } }, "Close") : null));
    const old = banners.get(id);
    if (old?.textContent === made.textContent) return;
    if (old) old.replaceWith(made); else bar.append(made);
    banners.set(id, made);
  }

  // ---- saved, or only kept
  function showSaved() {
    const { file } = editor.state ?? {};
    if (!file) return;
    const [kind, words] = !up ? ["lost", "no server"]
      : editor.pending || editor.typing?.() ? ["sending", "keeping …"]
      : file.saved ? ["saved", "saved"] : ["draft", "saved as draft"];
    if (saved.textContent !== words) saved.textContent = words;
    saved.className = `kept ${kind}`;
    saved.title = { draft: `Every edit is kept beside ${file.name} as it is made; Save writes the file itself`, saved: `${file.name} is as you see it` }[kind] ?? "";
    save.disabled = !up || (file.saved && file.outside === null && !editor.pending && !editor.typing?.());
    save.title = "Write the file (Ctrl S)";
  }

  async function saving(resolve = null) {
    if ((await editor.flush?.()) === false) return null; // it would not be what is seen
    try {
      const state = await editor.save(resolve);
      if (state.file.saved) editor.say(resolve === "theirs" ? `As ${state.file.name} is on disk` : `Saved ${state.file.name}`);
      return state;
    } catch (refused) {
      return refused.body?.conflict ? clash() : null;
    }
  }
  editor.saving = saving;
  save.addEventListener("click", () => saving());
  addEventListener("keydown", (event) => {
    if (!(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== "s" || event.altKey) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    showSaved(); // the button may still show the state before the last edit
    if (!save.disabled || editor.pending || editor.typing?.()) saving(); else editor.say("Saved already");
  }, true);

  // ---- another program changed the file
  async function clash() {
    if (asking) return null;
    asking = true;
    const answer = await ask({
      title: `Another program changed ${editor.state.file.name}`,
      body: "You changed it, too. Which version should be kept? The other stays in the history: Undo brings it back.",
      choices: [{ value: "mine", label: "Overwrite with mine", main: true }, { value: "theirs", label: "Reload theirs" }, { value: null, label: "Not now" }],
    });
    asking = false;
    return answer === null ? null : saving(answer);
  }

  const outside = () => {
    const { file } = editor.state;
    if (file.outside === "changed") banner("outside", `Another program changed ${file.name} while you edited it.`, [["Choose …", () => saving()]], { kind: "warn", closes: false });
    else if (file.outside === "gone") banner("outside", `${file.name} is no longer in its folder. Your text is kept; Save writes the file again.`, [["Save", () => saving()]], { kind: "warn", closes: false });
    else banner("outside", null);
  };

  // ---- events of the server
  editor.on("server", (event) => {
    if (event.type !== "file") return;
    const { name } = editor.state.file;
    if (event.outcome === "taken") banner("taken", `Another program changed ${name}: its text is shown now. Undo goes back.`);
    editor.catchUp();
  });

  let first = true;
  editor.on("state", ({ state }) => {
    if (first) {
      first = false;
      if (state.file.recovered && !state.file.saved) banner("recovered", "These edits of the last session were not saved. Undo takes them back.",
        [["Back to the saved file", async () => { banner("recovered", null); await saving("theirs"); }]]);
    } else if (state.file.saved) banner("recovered", null);
    outside();
    setTimeout(showSaved); // once the edit that brought it counts as answered
  });
  setInterval(showSaved, 250);

  // ---- a server that went away
  editor.on("link", ({ up: now }) => {
    up = now;
    if (up) editor.say("The server is back");
    const { name, folder } = editor.state.file, command = `physgen edit ${quoted(`${folder}/${name}`)}`;
    banner("link", up ? null : `The editor's server does not answer. Earlier edits are kept; new ones are not. Start it again, and open the address that it prints: ${command}`,
      [["Copy the command", () => editor.copy(command)]], { kind: "bad", closes: false });
    showSaved();
  });

  addEventListener("beforeunload", (event) => {
    if (!editor.state) return;
    if (!editor.state.file.saved || editor.pending || editor.typing?.()) { event.preventDefault(); event.returnValue = ""; }
  });

  // ---- text to the clipboard, also where the browser has none for pages of this kind
  editor.copy = async (text) => {
    try {
      await navigator.clipboard.writeText(text);
    } catch {
      const field = element("textarea", { class: "unseen", "aria-hidden": "true" });
      field.value = text;
      document.body.append(field);
      field.select();
      document.execCommand("copy");
      field.remove();
    }
    editor.say("Copied");
  };
}

const quoted = (path) => (/^[\w./+-]+$/.test(path) ? path : `'${path.replaceAll("'", "'\\''")}'`);
