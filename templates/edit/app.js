// The editor of one scene: its state, what is chosen, its tools and panels; everything else is a module that is given it.

import { Refused, ask, beginning } from "./api.js";
import { element, icon, part } from "./elements.js";

const listeners = new Map(), tools = new Map(), panels = [];
let queue = Promise.resolve(), wanted = null, asking = false, dragged = 0, late = false;

export const editor = {
  state: null,     // as the server knows it
  selected: null,  // {kind: "object" | "boundary" | "joint" | "field" | "force" | "light", name}
  tool: null,
  variant: null,
  tried: null,  // {motion, problems} of edits that are not made yet
  materials: [],
  stage: null, player: null,

  on(event, listener) { listeners.set(event, [...(listeners.get(event) || []), listener]); },
  // one listener's fault does not keep the others from hearing
  emit(event, what) {
    for (const listener of listeners.get(event) || []) try { listener(what); } catch (error) { console.error(`${event}: ${error.stack}`); }
  },

  // a state from the server -> everywhere
  take(state) {
    if (!state || (editor.state && state.version < editor.state.version)) return editor.state;
    const before = editor.state, variant = state.variant ?? null;
    if (before && variant !== (editor.variant ?? null)) return editor.refresh(); // of a tab that was left meanwhile
    if (variant !== null && !state.variants.includes(variant)) return editor.useVariant(null); // it was taken back
    [editor.state, editor.variant] = [state, variant];
    if (editor.selected && !named(editor.selected)) editor.choose(renamed(editor.selected));
    editor.tried = null;
    editor.emit("state", { state, before });
    return state;
  },
  async refresh() { return editor.take(await ask("GET", `/api/state${inVariant()}`)); },
  // something happened elsewhere: asked for at once, or once the answers that are on their way have come
  catchUp() {
    late = Boolean(editor.pending);
    if (!late) editor.refresh().catch(() => {});
  },
  async useVariant(name) {
    const was = editor.variant;
    editor.variant = name;
    try {
      return editor.take(await ask("GET", `/api/state${inVariant()}`));
    } catch (refused) {
      if (editor.variant === name) editor.variant = was; // what is shown is what is edited
      throw refused;
    }
  },

  // edits wait for one another; one that comes too late is made again on what is there now
  edit(ops, what, tag = null) {
    [wanted, dragged] = [null, dragged + 1]; // answers to what was tried until now come too late
    return queued("/api/edit", { ops, what, tag });
  },
  request: ask,
  waiting: [],     // edits that are not answered yet: {path, variant, body}
  get pending() { return editor.waiting.length; },
  maskOp(op) { return queued("/api/mask", { op }); },
  // a text, or what gives it when its turn has come
  putText(text) { return queued("/api/text", { text }); },
  async undo() { return editor.state?.undo || editor.pending ? announced("Undone: ", "redo", queued("/api/undo", {})) : editor.say("Nothing to undo"); },
  async redo() { return editor.state?.redo || editor.pending ? announced("Done again: ", "undo", queued("/api/redo", {})) : editor.say("Nothing to redo"); },
  save(resolve = null) { return queued("/api/save", { resolve }); },
  // all that waits is answered
  async idle() { while (editor.pending) await queue; },

  // what the scene would do; only the newest is asked for
  preview(ops) {
    if (!ops) { wanted = null; dragged += 1; editor.tried = null; editor.emit("preview", null); return; }
    wanted = ops;
    if (!asking) asked();
  },

  select(name) { editor.choose(name === null ? null : { kind: "object", name }); },
  choose(entry) {
    if (same(editor.selected, entry)) return;
    editor.selected = entry;
    editor.emit("select", entry);
  },

  registerTool(tool) {
    tools.set(tool.name, tool);
    const made = element("button", { type: "button", class: "tool", "data-tool": tool.name, "aria-pressed": false, "aria-label": tool.label,
      "aria-keyshortcuts": tool.key, title: tool.key ? `${tool.label} (${tool.key})` : tool.label, on: { click: () => editor.useTool(tool.name) } },
    icon(tool.icon), element("span", { "aria-hidden": true }, tool.short || tool.label));
    part("tools").append(made);
    if (!editor.tool) editor.useTool(tool.name);
  },
  useTool(name) {
    const next = tools.get(name);
    if (!next || next === editor.tool) return;
    editor.tool?.cancel?.();
    editor.tool = next;
    for (const made of part("tools").querySelectorAll("[data-tool]")) made.setAttribute("aria-pressed", made.dataset.tool === name);
    editor.emit("tool", next);
  },
  tools,

  addPanel({ id, title, element: body, order = 50 }) {
    const tab = element("button", { type: "button", role: "tab", id: `tab-${id}`, "aria-controls": `panel-${id}`, "aria-selected": false, tabindex: -1,
      on: { click: () => {
        editor.showPanel(id);
        if (matchMedia("(max-width: 900px)").matches) part("tabs").scrollIntoView({ block: "start" }); // the panel is below the photo
      } } }, title);
    const panel = element("div", { class: "panel", role: "tabpanel", id: `panel-${id}`, "aria-labelledby": `tab-${id}`, tabindex: 0, hidden: true }, body);
    panels.push({ id, tab, panel, order });
    panels.sort((one, other) => one.order - other.order);
    part("tabs").replaceChildren(...panels.map((p) => p.tab));
    part("bodies").append(panel);
    editor.showPanel(editor.panel || panels[0].id);
    const badge = (text) => { tab.replaceChildren(title); if (text != null) tab.append(" ", element("span", { class: "badge" }, String(text))); };
    return { tab, panel, badge, show: () => editor.showPanel(id) };
  },
  showPanel(id) {
    editor.panel = id;
    for (const { id: own, tab, panel } of panels) {
      tab.setAttribute("aria-selected", own === id);
      tab.tabIndex = own === id ? 0 : -1;
      panel.hidden = own !== id;
    }
    editor.emit("panel", id);
  },

  // one line for eyes and for screen readers; kind: "note" or "error"
  say(text, kind = "note") {
    const [line, other] = kind === "error" ? [part("alarm"), part("status")] : [part("status"), part("alarm")];
    other.textContent = "";
    line.textContent = text;
    clearTimeout(line.timer);
    line.timer = setTimeout(() => { line.textContent = ""; }, kind === "error" ? 12000 : 4000);
    editor.emit("say", { text, kind });
  },
  photoPoint: (event) => editor.stage.point(event), // [x, y], px of the photo
  redraw() { editor.stage?.redraw(); },
  overlays: [],
  overlay(draw) { editor.overlays.push(draw); }, // draw(context, pen), on each redraw
};

const inVariant = () => (editor.variant ? `?variant=${encodeURIComponent(editor.variant)}` : "");
export const same = (one, other) => one?.kind === other?.kind && one?.name === other?.name;

// an object of the scene, by kind and name -> what the file has of it
const PLACES = { object: "objects", boundary: "boundaries", joint: "joints", field: "fields", force: "forces" };
export function named({ kind, name }) {
  const { scene } = editor.state || {};
  if (!scene) return null;
  return kind === "light" ? scene.light : scene[PLACES[kind]]?.[name] ?? null;
}
// an object that an edit on its way gives another name stays chosen, whichever answer has it first
function renamed(entry) {
  const { to } = editor.waiting.flatMap(({ body }) => body.ops || []).find((op) => `${op.rename}` === `${pathOf(entry)}`) || {};
  const now = { ...entry, name: to };
  return to !== undefined && named(now) ? now : null;
}
export const pathOf = ({ kind, name }) => (kind === "light" ? ["light"] : [PLACES[kind], name]);

let linked = true; // whether the server answers
function link(up) {
  if (up === linked) return;
  linked = up;
  editor.emit("link", { up });
  if (up) editor.refresh().catch(() => {});
}

// One after the other; what was made of an older version is made again on what is there now, if that means the same.
function queued(path, body, variant = editor.variant) {
  const job = { path, variant, body };
  if (editor.waiting.some((other) => other.path === "/api/mask")) editor.say(`${DEEDS[path]} when the correction is done`);
  if (path !== "/api/save") part("undo").disabled = false; // it can be asked for behind what waits
  editor.waiting.push(job);
  meant.set(job, editor.state);
  const done = queue.then(async () => {
    for (let tries = 0; ; tries += 1) {
      try {
        if (!stillMeant(job, meant.get(job), editor.state)) throw new Refused(409, ELSEWHERE);
        const state = await sent(job);
        link(true);
        for (const later of editor.waiting) meant.set(later, state);
        return editor.take(state);
      } catch (refused) {
        const { status, body: why } = refused;
        if (status === 409 && !why.conflict && !why.elsewhere && tries < 4) { await editor.refresh(); continue; }
        if (status === 0 || status === 401) link(false);
        if (!why?.conflict) editor.say(refused.message, "error");
        throw refused;
      }
    }
  }).finally(() => {
    editor.waiting.splice(editor.waiting.indexOf(job), 1);
    if (editor.pending) return;
    part("undo").disabled = !editor.state.undo;
    if (late) editor.catchUp();
  });
  queue = done.catch(() => {});
  return done;
}

const DEEDS = { "/api/undo": "Undone", "/api/redo": "Done again", "/api/save": "Saved", "/api/mask": "Corrected", "/api/edit": "Done", "/api/text": "Taken" };
const meant = new WeakMap(); // a job -> the state that it was meant for: the last one that this window made, or saw
const ELSEWHERE = { error: { message: "something else was edited meanwhile", fix: "look, and do it again" }, elsewhere: true };

// what was meant for another state is made only where it means the same now: the third push is another one perhaps
function stillMeant({ path, body }, before, after) {
  if (before.version === after.version || (before.text === after.text && before.undo === after.undo)) return true;
  if (path === "/api/undo" || path === "/api/redo") return false;
  return (body.ops || []).every((op) => {
    const keys = op.set || op.unset || op.remove || op.rename || [], index = keys.findIndex((key) => typeof key === "number");
    const item = ({ scene }) => JSON.stringify(keys.slice(0, index + 1).reduce((found, key) => found?.[key], scene));
    return index < 0 || (before.scene && after.scene && item(before) === item(after));
  });
}

function sent({ path, variant, body }) {
  const made = Object.fromEntries(Object.entries(body).map(([key, value]) => [key, typeof value === "function" ? value() : value]));
  return ask(path === "/api/text" ? "PUT" : "POST", path, { version: editor.state.version, variant, ...made });
}

// the answer knows what was undone: it could be done again now
async function announced(before, way, done) {
  const state = await done.catch(() => null);
  if (state) editor.say(before + state[way]);
  return state;
}

async function asked() {
  asking = true;
  while (wanted) {
    const ops = wanted, drag = dragged;
    wanted = null;
    try {
      const found = await ask("POST", "/api/preview", { version: editor.state.version, variant: editor.variant, ops });
      if (drag !== dragged || found.overtaken) continue;
      editor.tried = found;
      editor.emit("preview", found);
    } catch (refused) {
      if (refused.status !== 409) editor.say(refused.message, "error");
      if (refused.status === 0) break;
    }
  }
  asking = false;
}

// a scene has the name of its folder where the file is called scene.yaml, as its clip has
const titleOf = ({ name, folder }) => (name === "scene.yaml" ? folder.split(/[\\/]/).pop() : name.replace(/\.ya?ml$/, "")) || name;

// ---- the bar and the tabs
part("undo").addEventListener("click", () => editor.undo());
part("redo").addEventListener("click", () => editor.redo());
editor.on("state", ({ state }) => {
  const title = state.scene?.title ?? titleOf(state.file);
  part("name").textContent = title;
  part("name").title = `${state.file.folder}/${state.file.name}`;
  document.title = `${state.file.saved ? "" : "• "}${title} · physgen`;
  part("saved").textContent = state.file.saved ? "saved" : "not saved";
  part("saved").classList.toggle("unsaved", !state.file.saved);
  for (const way of ["undo", "redo"]) {
    part(way).disabled = !state[way] && !(way === "undo" && editor.pending > 1); // the one that is answered still counts
    part(way).title = state[way] ? `${way === "undo" ? "Undo" : "Redo"}: ${state[way]} (Ctrl ${way === "undo" ? "Z" : "Y"})` : "";
  }
  part("waiting").hidden = true;
});
part("tabs").addEventListener("keydown", (event) => {
  const by = { ArrowRight: 1, ArrowLeft: -1 }[event.key], at = panels.findIndex((p) => p.id === editor.panel);
  const next = event.key === "Home" ? 0 : event.key === "End" ? panels.length - 1 : by ? (at + by + panels.length) % panels.length : null;
  if (next === null) return;
  editor.showPanel(panels[next].id);
  panels[next].tab.focus();
  event.preventDefault();
  event.stopPropagation();
});
part("tools").addEventListener("keydown", (event) => {
  const by = { ArrowDown: 1, ArrowRight: 1, ArrowUp: -1, ArrowLeft: -1 }[event.key];
  if (!by) return;
  const all = [...part("tools").querySelectorAll("button")], at = all.indexOf(document.activeElement);
  all[(at + by + all.length) % all.length].focus();
  event.preventDefault();
  event.stopPropagation();
});

// ---- begin: each module is given the editor, and may be asked by the others
const MODULES = ["stage", "listed", "player", "timeline", "final", "arrows", "pick", "walls", "limits", "joints", "inspect", "world", "measure", "light", "keys",
  "variants", "todo", "perceived", "masks", "yaml", "keep", "render", "hint"];
async function begin() {
  for (const name of MODULES) {
    try {
      (await import(`./${name}.js`)).start(editor);
    } catch (error) {
      console.warn(`${name}: ${error.message}`);
    }
  }
  let listen;
  try {
    listen = await beginning();
    editor.materials = await ask("GET", "/api/materials");
    await editor.refresh();
  } catch (refused) {
    part("waiting").textContent = refused.message;
    editor.say(refused.message, "error");
    return;
  }
  listen((event) => {
    if (event.type === "lost" || event.type === "found") link(event.type === "found");
    else {
      const { version, file } = editor.state;
      if (event.type === "version" && (event.version > version || (event.version === version && event.saved !== file.saved))) editor.catchUp();
      editor.emit("server", event);
    }
  });
  document.body.dataset.ready = "true";
}
if (document.readyState === "loading") addEventListener("DOMContentLoaded", begin); else begin();
