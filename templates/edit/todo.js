// What is wrong, odd or doubtful in the scene, worst first: each leads to its object, and its fix is a button.

import { element, isolated } from "./elements.js";
import { described } from "./perceived.js";

const SAID = { error: "Error", lint: "Odd", doubt: "Unsure" };
const STEP = 40; // shown at once

export function start(editor) {
  const sums = element("p", { class: "todo-sums", role: "status" });
  const list = element("ul", { class: "todo", "aria-label": "To do" });
  const more = element("button", { type: "button", class: "act", hidden: true, on: { click: () => { shown += STEP; drawn(); } } }, "Show more");
  const photo = element("details", { class: "perceived-found", hidden: true });
  const body = element("div", { class: "todo-panel sheet" }, photo, sums, list, more);
  const panel = editor.addPanel({ id: "todo", title: "To do", element: body, order: 30 });
  let items = [], shown = STEP, counted = null;

  const key = (item) => `${item.kind} ${item.object ?? ""} ${item.path ?? ""} ${item.text}`;

  editor.on("state", ({ state }) => {
    items = state.todo ?? [];
    photo.hidden = !state.perceived;
    if (state.perceived) {
      const { verdict, summary } = state.perceived;
      photo.replaceChildren(element("summary", {}, `The photo: ${verdict.split(":")[0]}`), ...described(verdict, summary));
    }
    const focused = list.contains(document.activeElement) ? [...list.querySelectorAll("button")].indexOf(document.activeElement) : -1;
    drawn();
    if (focused >= 0) { // the next row takes the place of the one that is done
      const buttons = [...list.querySelectorAll("button")];
      (buttons[Math.min(focused, buttons.length - 1)] ?? panel.tab).focus({ preventScroll: true });
    }
    if (counted !== null && items.length < counted && panel.panel.hidden === false) editor.say(items.length ? `${items.length} left to do` : "Nothing is left to do");
    counted = items.length;
  });

  function drawn() {
    panel.badge?.(items.length ? String(items.length) : null);
    const tally = Object.entries(SAID).map(([kind, word]) => [items.filter((item) => item.kind === kind).length, word.toLowerCase()]).filter(([count]) => count);
    sums.textContent = items.length ? tally.map(([count, word]) => `${count} ${word}`).join(", ") : editor.state?.scene ? "Nothing to do: every value was set by hand or is certain enough." : "The file cannot be read yet: see YAML.";
    list.replaceChildren(...items.slice(0, shown).map(made));
    more.hidden = items.length <= shown;
    marked();
  }

  function made(item) {
    const entry = meant(item);
    const choose = () => {
      if (entry) editor.choose(entry);
      if (item.line && (item.kind === "error" || !entry)) editor.goToLine?.(item.line);
    };
    const fix = async () => {
      if (entry) editor.choose(entry);
      try { await editor.edit(item.ops, item.fix); } catch { /* reported by the editor */ }
    };
    return element("li", { class: `todo-item ${item.kind}`, "data-object": item.object ?? "", "data-key": key(item) },
      element("button", { type: "button", class: "todo-what", on: { click: choose } },
        element("span", { class: "todo-kind" }, SAID[item.kind] ?? item.kind),
        entry ? element("b", {}, isolated(String(entry.name))) : null,
        element("span", { class: "todo-text" }, item.text)),
      element("div", { class: "todo-acts" },
        item.fix ? (item.ops ? element("button", { type: "button", class: "act", on: { click: fix } }, upper(item.fix)) : element("span", { class: "todo-hint" }, upper(item.fix))) : null,
        item.line ? element("button", { type: "button", class: "link", "aria-label": `Line ${item.line} of the file`, on: { click: () => editor.goToLine?.(item.line) } }, `line ${item.line}`) : null));
  }

  function marked() {
    const name = editor.selected?.kind === "object" ? editor.selected.name : null;
    for (const row of list.children) row.classList.toggle("chosen", Boolean(name) && row.dataset.object === name);
  }
  editor.on("select", marked);
}

// what a row is about: the object that it names, or what its path leads to
const KINDS = { objects: "object", boundaries: "boundary", joints: "joint", fields: "field" };
function meant({ object, path }) {
  if (object) return { kind: "object", name: object };
  const [section, name] = Array.isArray(path) ? path : String(path ?? "").split(".");
  if (section === "light") return { kind: "light", name: "light" };
  return KINDS[section] && name ? { kind: KINDS[section], name } : null;
}

const upper = (text) => text.slice(0, 1).toUpperCase() + text.slice(1);
