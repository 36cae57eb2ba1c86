// The scene file as text beside the picture: typed text goes to the server, edits made elsewhere come back into it.
// A text field over a drawing of the same lines: only the lines in sight are drawn, so a long file costs nothing.

import { element } from "./elements.js";
import { changed, joined, objectLines, parts, plainEnds, withEnds } from "./marks.js";

const PAUSE = 300; // ms without a key before typed text is sent
const SPARE = 6;   // lines drawn beyond those in sight

export function start(editor) {
  const sums = element("span", { class: "yaml-sums" });
  const next = element("button", { type: "button", class: "act", title: "Next problem (F8)", hidden: true, on: { click: () => nextProblem() } }, "Next");
  const numbers = element("div", { class: "yaml-numbers", "aria-hidden": "true" });
  const under = element("div", { class: "yaml-under", "aria-hidden": "true" });
  const field = element("textarea", { class: "yaml-text", spellcheck: "false", autocomplete: "off", autocapitalize: "off", autocorrect: "off", wrap: "off",
    "aria-label": "The scene file, as YAML", "aria-describedby": "yaml-keys yaml-problems", "data-part": "yaml", readonly: true });
  const list = element("ul", { class: "yaml-problems", id: "yaml-problems", "aria-label": "Problems of the file", "aria-live": "polite" });
  const body = element("div", { class: "yaml" },
    element("div", { class: "yaml-head" }, sums, next),
    element("div", { class: "yaml-field" }, numbers, element("div", { class: "yaml-window" }, under, field)),
    list,
    element("p", { class: "note", id: "yaml-keys" }, "What you type is applied at once. Ctrl Z undoes, F8 goes to the next problem, Tab leaves the text."));
  const panel = editor.addPanel({ id: "yaml", title: "YAML", element: body, order: 40 });

  let known = null;        // the text as the server has it, with plain line ends
  let raw = "";            // the same with its own
  let sent = null;         // what is on its way
  let inflight = null;     // whether that is taken, once it is known
  let refused = null;      // what will not be taken as it is
  let timer, lines = [""], blocks = {}, chosen = null, problems = [], announced = 0, height = 20, pad = 8, ink = null;

  const dirty = () => known !== null && field.value !== known;
  editor.typing = dirty;

  // ---- text to and fro
  async function sending() {
    sent = field.value;
    try {
      await editor.putText(() => withEnds(raw, (sent = field.value)));
      return true;
    } catch ({ status }) { // reported by the editor; the text stays here
      refused = [0, 409, 507].includes(status) ? null : sent;
      return false;
    } finally {
      [sent, inflight] = [null, null];
      if (dirty()) later();
    }
  }
  const send = () => { clearTimeout(timer); return (inflight ??= sending()); };
  const due = () => { if (dirty() && field.value !== refused) send(); };
  const later = () => { clearTimeout(timer); timer = setTimeout(due, PAUSE); };
  // -> whether all that was typed is taken
  editor.flush = async () => {
    while (dirty() || inflight) if (!(await send())) return false;
    return true;
  };

  // the field's text, with its caret, its place and (where nothing differs) its own undo left alone
  function put(text) {
    if (field.value === text) return;
    const [from, to, first, last] = changed(field.value, text), { scrollTop, scrollLeft } = field;
    field.setRangeText(text.slice(first, last), from, to, "preserve");
    field.scrollTop = scrollTop;
    field.scrollLeft = scrollLeft;
  }

  editor.on("state", ({ state, before }) => {
    const text = plainEnds(state.text);
    raw = state.text;
    if (!dirty() && text !== sent) put(text);
    else if (text !== sent && text !== field.value) {
      const both = joined(known, field.value, text); // another program changed other lines while these were typed
      if (both !== null) put(both);
      later();
    }
    known = text;
    field.readOnly = false;
    problems = state.problems ?? [];
    read();
    listed();
    paint();
    const first = problems.find((problem) => problem.severity === "error" && problem.line);
    if (!before && !state.scene && first) goTo(first.line, first.column, { focus: false }); // there is nothing else to see
  });

  // ---- what the lines are
  function read() {
    lines = field.value.split("\n");
    blocks = objectLines(lines);
  }

  function measure() {
    const style = getComputedStyle(field);
    height = parseFloat(style.lineHeight) || 20;
    pad = parseFloat(style.paddingTop) || 0;
    ink ??= document.createElement("canvas").getContext("2d");
    ink.font = style.font || `${style.fontSize} ${style.fontFamily}`;
  }

  function paint() {
    if (panel.panel.hidden) return;
    const first = Math.max(0, Math.floor((field.scrollTop - pad) / height) - SPARE);
    const last = Math.min(lines.length, Math.ceil((field.scrollTop + field.clientHeight) / height) + SPARE);
    const wrong = worst(), [from, to] = (chosen && blocks[chosen]) || [-1, -2], here = caretLine();
    const rows = [], margins = [];
    for (let k = first; k < last; k += 1) {
      const kinds = [wrong.get(k + 1)?.severity === "error" && "wrong", wrong.has(k + 1) && wrong.get(k + 1).severity !== "error" && "odd", k >= from && k <= to && "chosen", k === here && "here"].filter(Boolean).join(" ");
      const row = element("div", { class: `yaml-line ${kinds}` });
      for (const [kind, letters] of parts(lines[k])) row.append(kind ? element("span", { class: `y-${kind}` }, letters) : letters);
      if (wrong.has(k + 1)) row.append(wave(wrong.get(k + 1), lines[k]));
      row.style.top = `${pad + k * height}px`;
      rows.push(row);
      const number = element("div", { class: `yaml-number ${kinds}` }, String(k + 1));
      number.style.top = `${pad + k * height - field.scrollTop}px`;
      margins.push(number);
    }
    under.replaceChildren(...rows);
    under.style.transform = `translate(${-field.scrollLeft}px, ${-field.scrollTop}px)`;
    numbers.replaceChildren(...margins);
    numbers.style.width = `${Math.max(2, String(lines.length).length) + 2.2}ch`;
  }

  // the line under what is wrong, from its column to the value's end
  function wave(problem, line) {
    const at = Math.max(0, (problem.column ?? 1) - 1);
    const word = line.slice(at).match(/^(?:"[^"]*"|'[^']*'|\[[^\]]*\]|[^\s,}\]#]+:?)/)?.[0] ?? line.slice(at).trimEnd();
    const begin = ink.measureText(line.slice(0, at)).width;
    const mark = element("i", { class: problem.severity === "error" ? "wave wrong" : "wave odd" });
    mark.style.left = `${begin + (parseFloat(getComputedStyle(field).paddingLeft) || 0)}px`;
    mark.style.width = `${Math.max(ink.measureText(word).width, 8)}px`;
    return mark;
  }

  function worst() {
    const found = new Map();
    for (const problem of problems) if (problem.line && (!found.has(problem.line) || problem.severity === "error")) found.set(problem.line, problem);
    return found;
  }

  // ---- problems in words
  function listed() {
    const errors = problems.filter((problem) => problem.severity === "error").length, odd = problems.length - errors;
    sums.textContent = [errors && `${errors} ${errors === 1 ? "error" : "errors"}`, odd && `${odd} ${odd === 1 ? "warning" : "warnings"}`].filter(Boolean).join(", ") || "No problems";
    sums.classList.toggle("wrong", errors > 0);
    next.hidden = !problems.some((problem) => problem.line);
    field.setAttribute("aria-invalid", String(errors > 0));
    panel.badge?.(errors ? String(errors) : null);
    list.replaceChildren(...problems.map((problem) => {
      const what = problem.fix ? `${problem.message}; ${problem.fix}` : problem.message;
      return element("li", { class: problem.severity === "error" ? "wrong" : "odd" },
        element("button", { type: "button", "data-line": problem.line ?? "", on: { click: () => goTo(problem.line, problem.column) } },
          element("b", {}, problem.line ? `${problem.severity === "error" ? "Error" : "Warning"}, line ${problem.line}` : problem.severity === "error" ? "Error" : "Warning"),
          problem.path ? element("code", {}, spelled(problem.path)) : null,
          element("span", {}, ` ${what}`)));
    }));
    list.hidden = problems.length === 0;
    const first = problems.find((problem) => problem.severity === "error");
    if (errors > announced && first && panel.panel.hidden) editor.say(`Line ${first.line}: ${first.message}`);
    announced = errors;
    pointed();
  }

  // the problem of the line in which the caret is stands out in the list
  function pointed() {
    const here = caretLine() + 1;
    for (const button of list.querySelectorAll("button")) button.classList.toggle("here", Number(button.dataset.line) === here);
  }

  function nextProblem() {
    const here = caretLine() + 1, lined = problems.filter((problem) => problem.line).sort((a, b) => a.line - b.line);
    const found = lined.find((problem) => problem.line > here) ?? lined[0];
    if (found) goTo(found.line, found.column);
  }

  // ---- places
  const caretLine = () => field.value.slice(0, field.selectionStart).split("\n").length - 1;
  const offset = (line) => lines.slice(0, line).reduce((sum, text) => sum + text.length + 1, 0);

  function goTo(line, column = 1, { focus = true } = {}) {
    if (!line) return;
    panel.show?.();
    const at = offset(line - 1) + Math.min((column ?? 1) - 1, (lines[line - 1] ?? "").length);
    field.setSelectionRange(at, at);
    if (focus) field.focus({ preventScroll: true });
    reveal(line - 1, line - 1);
    pointed();
  }
  editor.goToLine = goTo;

  function reveal(from, to) {
    const top = pad + from * height, bottom = pad + (to + 1) * height;
    if (top >= field.scrollTop && bottom <= field.scrollTop + field.clientHeight) return paint();
    field.scrollTop = bottom - top > field.clientHeight - 2 * height ? top - height : (top + bottom - field.clientHeight) / 2;
    paint();
  }

  let own = false; // the choice was made by the caret
  editor.on("select", (entry) => {
    chosen = entry?.kind === "object" ? entry.name : null;
    if (!own && chosen && blocks[chosen] && !panel.panel.hidden && document.activeElement !== field) reveal(...blocks[chosen]);
    else paint();
  });

  function chooseByCaret() {
    pointed();
    const here = caretLine();
    const name = Object.keys(blocks).find((key) => blocks[key][0] <= here && here <= blocks[key][1]);
    if (name && name !== chosen && editor.state?.scene?.objects?.[name]) {
      own = true;
      editor.select(name);
      own = false;
    } else paint();
  }

  // ---- hands
  field.addEventListener("input", () => { read(); paint(); later(); });
  field.addEventListener("scroll", paint);
  field.addEventListener("blur", due);
  field.addEventListener("click", chooseByCaret);
  field.addEventListener("keyup", (event) => { if (/^(Arrow|Page|Home|End)/.test(event.key)) chooseByCaret(); });
  field.addEventListener("keydown", (event) => {
    event.stopPropagation(); // the page's keys are letters here
    const key = event.key.toLowerCase(), held = event.ctrlKey || event.metaKey;
    const run = (task) => { event.preventDefault(); task(); };
    if (event.isComposing) return;
    if (held && key === "z" && !event.shiftKey && !dirty()) run(() => editor.undo());
    else if (held && (key === "y" || (key === "z" && event.shiftKey)) && !dirty()) run(() => editor.redo());
    else if (held && key === "/") run(remark);
    else if (event.key === "F8") run(nextProblem);
    else if (event.key === "Enter" && !held && !event.shiftKey) run(() => type(`\n${deep(lines[caretLine()].slice(0, field.selectionStart - offset(caretLine())))}`));
    else if (event.key === "Escape") run(() => panel.tab.focus());
  });

  // letters as if typed: the browser's undo knows of them
  function type(letters) {
    if (!document.execCommand("insertText", false, letters)) field.setRangeText(letters, field.selectionStart, field.selectionEnd, "end");
  }

  // the chosen lines as comments, or back
  function remark() {
    const from = caretLine(), to = field.value.slice(0, Math.max(field.selectionEnd - 1, field.selectionStart)).split("\n").length - 1;
    const mine = lines.slice(from, to + 1), off = mine.every((line) => /^\s*#/.test(line) || !line.trim());
    const turned = mine.map((line) => (off ? line.replace(/^(\s*)# ?/, "$1") : line.trim() ? `# ${line}` : line)).join("\n");
    field.setSelectionRange(offset(from), offset(to) + lines[to].length);
    type(turned);
  }

  new ResizeObserver(() => {
    measure();
    if (document.activeElement === field) reveal(caretLine(), caretLine()); else paint();
  }).observe(field);
  editor.on("panel", (id) => {
    if (id !== "yaml") return;
    measure();
    if (chosen && blocks[chosen]) reveal(...blocks[chosen]); else paint();
  });
}

// how far in the next line begins: as far as this one, two more behind a key that opens a mapping
const deep = (line) => line.match(/^ */)[0] + (/^[^#]*:\s*(?:#.*)?$/.test(line) && line.trim() ? "  " : "");

// ["objects", "a", "mass"] or "objects.a.mass" -> objects.a.mass
const spelled = (path) => (Array.isArray(path) ? path.map((key, k) => (typeof key === "number" ? `[${key}]` : k ? `.${key}` : key)).join("") : path);
