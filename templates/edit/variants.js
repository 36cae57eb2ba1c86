// The scene's variants as tabs: edits made in a tab go to that variant; the motion of another may stay as a ghost.

import { ask } from "./dialogs.js";
import { element, icon, isolated, part } from "./elements.js";
import { objectLines } from "./marks.js";

const BASE = "scene"; // the file without a variant
const NAME = /^[A-Za-z][A-Za-z0-9_-]{0,63}$/;

export function start(editor) {
  const tabs = element("div", { class: "variant-tabs", role: "tablist", "aria-label": "Variants" });
  const plus = element("button", { type: "button", class: "round small", "aria-label": "New variant", title: "New variant: named edits of this scene", on: { click: () => create() } }, icon("M11 5h2v6h6v2h-6v6h-2v-6H5v-2h6z"));
  const menu = element("details", { class: "variant-menu" },
    element("summary", { class: "round small", "aria-label": "This variant", title: "Rename, duplicate, delete, compare" }, icon("M6 10a2 2 0 1 0 0 4 2 2 0 0 0 0-4m6 0a2 2 0 1 0 0 4 2 2 0 0 0 0-4m6 0a2 2 0 1 0 0 4 2 2 0 0 0 0-4")),
    element("div", { class: "variant-list" }));
  const place = part("variants");
  place.append(tabs, plus, menu);
  let ghost = null; // the variant whose motion is shown beside

  const names = () => editor.state?.variants ?? [];
  const act = (words, run, attributes = {}) => element("button", { type: "button", ...attributes, on: { click: () => { menu.open = false; run(); } } }, words);

  function drawn() {
    if (!editor.state) return;
    const held = tabs.contains(document.activeElement);
    tabs.replaceChildren(...[null, ...names()].map((name) => element("button", {
      type: "button", role: "tab", class: ghost !== null && ghost.name === name ? "variant-tab compared" : "variant-tab", "data-variant": name ?? "", "aria-selected": String((editor.variant ?? null) === name),
      tabindex: (editor.variant ?? null) === name ? 0 : -1, title: name === null ? "The file itself" : `Edits go to variants.${name}`,
      on: { click: () => use(name), dblclick: () => name && rename() } }, name === null ? BASE : isolated(name))));
    const here = tabs.querySelector("[aria-selected=true]");
    if (held) here?.focus({ preventScroll: true });
    if (here && tabs.scrollWidth > tabs.clientWidth) here.scrollIntoView({ block: "nearest", inline: "nearest" });
    place.classList.toggle("alone", names().length === 0);
    const own = editor.variant ?? null, others = [null, ...names()].filter((name) => name !== own);
    menu.lastElementChild.replaceChildren(
      act("New variant …", create),
      ...(own ? [act("Rename …", rename), act("Duplicate …", duplicate), act("Delete", remove, { class: "bad" })] : []),
      ...(others.length ? [element("p", {}, "Compare with"), ...others.map((name) => act(name ?? BASE, () => compare(name), { "aria-pressed": String(ghost !== null && ghost.name === name) }))] : []),
      ...(ghost ? [act("No comparison", () => compare(undefined))] : []));
  }
  editor.on("state", drawn);

  async function use(name) {
    if ((editor.variant ?? null) === name) return;
    await editor.flush?.();
    try { await editor.useVariant(name); editor.say(name ? `Variant ${name}: edits go there` : "The scene itself"); } catch (refused) { editor.say(refused.message, "error"); }
  }

  tabs.addEventListener("keydown", (event) => {
    const all = [...tabs.children], at = all.indexOf(document.activeElement);
    const by = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    const next = event.key === "Home" ? 0 : event.key === "End" ? all.length - 1 : by ? (at + by + all.length) % all.length : -1;
    if (event.key === "F2" && editor.variant) rename();
    else if (event.key === "Delete" && editor.variant) remove();
    else if (next >= 0) { all[next].focus(); all[next].click(); } else return;
    event.preventDefault();
    event.stopPropagation();
  });
  document.addEventListener("click", (event) => { if (menu.open && !menu.contains(event.target)) menu.open = false; });
  menu.addEventListener("keydown", (event) => { if (event.key === "Escape" && menu.open) { menu.open = false; menu.firstElementChild.focus(); event.stopPropagation(); } });

  const check = (text) => (!NAME.test(text) ? "A name has letters, digits, - and _, and starts with a letter." : names().includes(text) ? `There is a variant ${text} already.` : null);
  const asked = (title, label, value = "") => ask({ title, input: { label: "Name", value, check }, choices: [{ value: true, label, main: true }, { value: null, label: "Cancel" }] });

  // variants are written in the file itself, whichever of them is open
  async function inFile(ops, what, then) {
    await editor.flush?.();
    const was = editor.variant ?? null;
    try {
      if (was !== null) await editor.useVariant(null);
      await editor.edit(ops, what);
      await editor.useVariant(then);
    } catch {
      await editor.useVariant(names().includes(was) ? was : null).catch(() => {});
    }
  }

  async function create() {
    const answer = await asked("New variant", "Create");
    if (answer) await inFile([{ add: ["variants", answer.text], value: {} }], `new variant ${answer.text}`, answer.text);
  }
  async function rename() {
    const was = editor.variant, answer = await asked(`Rename ${was}`, "Rename", was);
    if (answer) await inFile([{ rename: ["variants", was], to: answer.text }], `${was} renamed to ${answer.text}`, answer.text);
  }
  // as text, so that its remarks come along
  async function duplicate() {
    const was = editor.variant, answer = await asked(`Duplicate ${was}`, "Duplicate", `${was}-2`);
    if (!answer) return;
    await editor.flush?.();
    const lines = editor.state.text.split("\n"), where = objectLines(lines, "variants")[was];
    if (!where) { editor.say(`variants: is written in one line; copy ${was} there, in YAML`, "error"); return; }
    const [first, last] = where, copy = lines.slice(first, last + 1);
    copy[0] = copy[0].replace(/^(\s*)(?:"[^"]*"|'[^']*'|[^\s:]+)/, `$1${answer.text}`);
    try {
      await editor.putText([...lines.slice(0, last + 1), ...copy, ...lines.slice(last + 1)].join("\n"));
      await use(answer.text);
    } catch { /* reported by the editor */ }
  }
  async function remove() {
    const was = editor.variant;
    if (await ask({ title: `Delete the variant ${was}?`, body: "The scene itself stays as it is. Undo brings the variant back.", choices: [{ value: true, label: "Delete", bad: true }, { value: null, label: "Keep", main: true }] }))
      await inFile([{ unset: ["variants", was] }], `variant ${was} deleted`, null);
  }

  // another variant's motion stays on the picture; the player draws it as the ghost
  async function compare(name) {
    ghost = null;
    if (name !== undefined) {
      try {
        const found = await editor.request("GET", `/api/state${name === null ? "" : `?variant=${encodeURIComponent(name)}`}`);
        ghost = { name, motion: found.motion };
      } catch (refused) { editor.say(refused.message, "error"); }
    }
    editor.emit("ghost", ghost);
    drawn();
  }
}
