// Nothing is lost: what is saved and what is kept only as a draft, a server that went away, a file that another program
// changed, a second window. Told in words under the bar; asked only where both sides changed the same lines.

import { own } from "./api.js";
import { ask } from "./dialogs.js";
import { element, part } from "./elements.js";
import { plainEnds } from "./marks.js";

const PATIENCE = 500; // ms in which a window that lives says so
const RECALL = 2000; // differing lines beyond which two texts are shown without marks

export function start(editor) {
  const bar = element("div", { class: "banners", "aria-label": "Messages", role: "region" });
  document.querySelector("header.bar").after(bar);
  const save = part("save"), saved = part("saved"), banners = new Map();
  const closed = new Set();
  let up = true, stranger = false, asking = false;
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
    const [kind, words] = !up ? ["lost", editor.pending ? `${edits(editor.pending)} waiting` : "no server"]
      : editor.pending || editor.typing?.() ? ["sending", "keeping …"]
      : file.saved ? ["saved", "saved"] : ["draft", "draft kept, not saved"];
    if (saved.textContent !== words) saved.textContent = words;
    saved.className = `kept ${kind}`;
    saved.title = { draft: `Every edit is kept beside ${file.name} as it is made; Save writes the file itself`, saved: `${file.name} is as you see it` }[kind] ?? "";
    save.disabled = !up || (file.saved && file.outside === null && !editor.pending && !editor.typing?.());
    save.title = "Write the file (Ctrl S)";
  }
  const edits = (count) => `${count} ${count === 1 ? "edit" : "edits"}`;

  async function saving(resolve = null) {
    if ((await editor.flush?.()) === false) return null; // it would not be what is seen
    try {
      const state = await editor.save(resolve);
      if (state.file.saved) editor.say(resolve === "theirs" ? `As ${state.file.name} is on disk` : `Saved ${state.file.name}`);
      return state;
    } catch (refused) {
      const conflict = refused.body?.conflict;
      if (conflict) return clash(conflict);
      return refused.body?.maps ? painted() : null;
    }
  }
  editor.saving = saving;
  save.addEventListener("click", () => saving());
  addEventListener("keydown", (event) => {
    if (!(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== "s" || event.altKey) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    if (!save.disabled || editor.pending || editor.typing?.()) saving(); else editor.say("Saved already");
  }, true);

  // ---- another program changed the file
  async function clash({ theirs, merged, clashes }) {
    if (asking) return null;
    asking = true;
    const mine = editor.state.text;
    const answer = await ask({
      title: `Another program changed ${editor.state.file.name}`, wide: true,
      body: [
        element("p", {}, merged === null ? `Both changed the same ${clashes?.length > 1 ? "places" : "place"}. Which is to stand? The other stays in the history: Undo brings it back.` : "The two can be put together: they changed different lines."),
        sideBySide(mine, theirs),
      ],
      choices: [
        ...(merged === null ? [] : [{ value: "merge", label: "Put both together", main: true }]),
        { value: "mine", label: "Mine", main: merged === null }, { value: "theirs", label: "Theirs" }, { value: null, label: "Not now" },
      ],
    });
    asking = false;
    return answer === null ? null : saving(answer);
  }

  async function painted() {
    if (asking) return null;
    asking = true;
    const mine = await ask({
      title: "Another program changed the masks",
      body: `It wrote the maps of ${editor.state.file.name} since yours were made. Write yours over them? Theirs stay in the history: Undo brings them back.`,
      choices: [{ value: "mine", label: "Write mine", main: true }, { value: null, label: "Not now" }],
    });
    asking = false;
    return mine === null ? null : saving(mine);
  }

  const outside = () => {
    const { file } = editor.state;
    if (file.outside === "changed") banner("outside", `Another program changed ${file.name} where you changed it, too.`, [["Look at both …", () => saving()]], { kind: "warn", closes: false });
    else if (file.outside === "gone") banner("outside", `${file.name} is no longer in its folder. What you see is kept; Save writes the file again.`, [["Save", () => saving()]], { kind: "warn", closes: false });
    else if (file.outside === "unread") banner("outside", `Another program changed ${file.name}, and that could not be taken in: the disk is full, or refuses. It is tried again and again; where physgen edit runs, the reason is printed.`, [], { kind: "bad", closes: false });
    else banner("outside", null);
  };

  // ---- events of the server
  editor.on("server", (event) => {
    if (event.type === "windows") windows(event.windows ?? event.count ?? 1);
    if (event.type === "file") {
      const { name } = editor.state.file;
      if (event.outcome === "taken") banner("merged", `Another program changed ${name}: this is its text now. Undo goes back.`);
      if (event.outcome === "merged") banner("merged", `Another program changed ${name}: its changes are put into yours. Undo takes them out.`);
      editor.catchUp();
    }
    if (event.type === "stranger") { stranger = true; up = false; lost(); others?.postMessage({ left: true }); }
  });

  function windows(count) {
    banner("windows", count > 1 ? `This scene is open in ${count} windows. They edit the same draft: each shows what the others do, and Undo undoes the newest edit, whoever made it.` : null, [], { kind: "warn" });
  }

  let first = true;
  editor.on("state", ({ state }) => {
    if (first) {
      first = false;
      if (state.file.recovered && !state.file.saved) banner("recovered", "These are the edits of last time, which were not saved. Undo goes back through them.",
        [["Back to the saved file", async () => { banner("recovered", null); await saving("theirs"); }]]);
      if (state.windows !== undefined) windows(state.windows);
      resend();
    } else if (state.file.saved) banner("recovered", null);
    outside();
    setTimeout(() => { showSaved(); store(); }); // once the edit that brought it counts as answered
  });
  setInterval(showSaved, 250);

  // ---- a server that went away: what is done meanwhile waits here, and in the browser's store if the page is closed
  editor.on("link", ({ up: now }) => {
    const waited = editor.pending;
    up = now;
    if (up) {
      banner("link", null);
      editor.say(waited ? `The server is back: ${edits(waited)} sent` : "The server is back");
      if (!waited) editor.refresh().catch(() => {});
    }
    lost();
    showSaved();
  });
  function lost() {
    if (up || !editor.state) return;
    if (stranger) {
      banner("link", `The editor was started anew and does not know this page. Open the address that it printed${editor.pending ? `: the ${edits(editor.pending)} that ${editor.pending === 1 ? "waits" : "wait"} here ${editor.pending === 1 ? "is" : "are"} asked about there` : ""}.`, [], { kind: "bad", closes: false });
      store();
      return;
    }
    const { name, folder } = editor.state.file;
    const command = `physgen edit ${quoted(`${folder}/${name}`)} --port ${location.port}`;
    banner("link", `The editor's server does not answer. Nothing is lost: ${editor.pending ? `${edits(editor.pending)} ${editor.pending === 1 ? "waits" : "wait"} here and ${editor.pending === 1 ? "is" : "are"} sent when it is back` : "what you do waits here and is sent when it is back"}. Start it again: ${command}`,
      [["Copy the command", () => editor.copy(command)]], { kind: "bad", closes: false });
    store();
  }
  setInterval(() => { if (!up) lost(); }, 500);

  // each window has a shelf of its own there, and clears no other's
  const shelf = () => `physgen-edit ${editor.state.file.folder}/${editor.state.file.name} `;
  let shelved = ""; // not put there again: a stranger's may have been made elsewhere
  function store() {
    const jobs = up ? [] : editor.waiting.map(whole).filter(({ path }) => path !== "/api/save"), now = JSON.stringify(jobs);
    if (now === shelved || (!jobs.length && editor.pending)) return;
    try {
      if (jobs.length) localStorage.setItem(shelf() + own, JSON.stringify({ time: Date.now(), jobs }));
      else localStorage.removeItem(shelf() + own);
      shelved = now;
    } catch { /* a browser that keeps nothing: the page asks before it is left */ }
  }
  const whole = ({ body, ...job }) => ({ ...job, body: Object.fromEntries(Object.entries(body).map(([key, value]) => [key, typeof value === "function" ? value() : value])) });

  // windows tell one another that they live, and send what waits in them; a stranger cannot any more
  const others = globalThis.BroadcastChannel && new BroadcastChannel("physgen-edit"), alive = new Set();
  others?.addEventListener("message", ({ data }) => {
    if (data.who && !stranger) others.postMessage({ lives: own });
    if (data.lives) alive.add(data.lives);
    if (data.left && up && editor.state) resend();
  });
  function left() {
    const windows = Object.keys(localStorage).filter((key) => key.startsWith(shelf())).map((key) => key.slice(shelf().length));
    return windows.filter((name) => /^\w+$/.test(name) && name !== own && !alive.has(name)).map((name) => shelf() + name);
  }

  // edits that waited in windows that were closed; their shelves are cleared once that is settled
  let recalled = Promise.resolve();
  const resend = () => (recalled = recalled.then(recall));
  async function recall() {
    try {
      alive.clear();
      if (!left().length) return;
      others?.postMessage({ who: true });
      await new Promise((done) => setTimeout(done, PATIENCE));
      const shelves = left(), kept = shelves.map((key) => JSON.parse(localStorage.getItem(key))).sort((one, other) => one.time - other.time);
      const notMade = ({ jobs: all }) => all.slice(1 + all.findIndex(({ id }) => id === editor.state.id));
      const jobs = [...new Map(kept.flatMap(notMade).map((job) => [job.id, job])).values()];
      const make = jobs.length > 0 && await ask({ title: `${edits(jobs.length)} waited in a window that was closed`, body: "The server was gone when they were made. Make them now?", choices: [{ value: true, label: "Make them", main: true }, { value: false, label: "Leave them out" }] });
      if (make) await Promise.allSettled(jobs.map(editor.again)); // one that is refused is reported by the editor; the next may still fit
      if (make !== null) for (const key of shelves) localStorage.removeItem(key);
    } catch { /* nothing kept */ }
  }

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

// Two texts -> a table of their differing places, with the lines around them.
function sideBySide(mine, theirs) {
  const rows = compared(plainEnds(mine).split("\n"), plainEnds(theirs).split("\n"));
  const near = rows.map((row, k) => rows.slice(Math.max(0, k - 2), k + 3).some(([a, b]) => a !== b));
  const body = element("tbody");
  rows.forEach(([a, b, left, right], k) => {
    if (!near[k]) { if (near[k - 1]) body.append(element("tr.gap", {}, element("td", { colspan: "4" }, "…"))); return; }
    const kind = a === b ? "" : "differs";
    body.append(element("tr", { class: kind }, element("th", {}, a === null ? "" : String(left + 1)), element("td", {}, a ?? ""), element("th", {}, b === null ? "" : String(right + 1)), element("td", {}, b ?? "")));
  });
  return element("div", { class: "both", tabindex: "0", role: "region", "aria-label": "Both texts" }, element("table", {},
    element("thead", {}, element("tr", {}, element("th", {}), element("th", { scope: "col" }, "Mine"), element("th", {}), element("th", { scope: "col" }, "Theirs"))), body));
}

// the longest common lines, between the ends that are alike
export function compared(mine, theirs) {
  let head = 0, tail = 0;
  const least = Math.min(mine.length, theirs.length);
  while (head < least && mine[head] === theirs[head]) head += 1;
  while (tail < least - head && mine[mine.length - 1 - tail] === theirs[theirs.length - 1 - tail]) tail += 1;
  const a = mine.slice(head, mine.length - tail), b = theirs.slice(head, theirs.length - tail), rows = [];
  for (let k = 0; k < head; k += 1) rows.push([mine[k], theirs[k], k, k]);
  const long = Array.from({ length: a.length + 1 }, () => new Uint16Array(b.length + 1));
  if (a.length <= RECALL && b.length <= RECALL)
    for (let i = a.length - 1; i >= 0; i -= 1) for (let j = b.length - 1; j >= 0; j -= 1) long[i][j] = a[i] === b[j] ? long[i + 1][j + 1] + 1 : Math.max(long[i + 1][j], long[i][j + 1]);
  let i = 0, j = 0;
  const left = [], right = [];
  const flush = () => { while (left.length || right.length) { const [x, y] = [left.shift(), right.shift()]; rows.push([x === undefined ? null : a[x], y === undefined ? null : b[y], head + (x ?? 0), head + (y ?? 0)]); } };
  while (i < a.length || j < b.length) {
    if (i < a.length && j < b.length && a[i] === b[j]) { flush(); rows.push([a[i], b[j], head + i, head + j]); i += 1; j += 1; }
    else if (j >= b.length || (i < a.length && long[i + 1][j] >= long[i][j + 1])) { left.push(i); i += 1; } else { right.push(j); j += 1; }
  }
  flush();
  for (let k = tail; k > 0; k -= 1) rows.push([mine[mine.length - k], theirs[theirs.length - k], mine.length - k, theirs.length - k]);
  return rows;
}
