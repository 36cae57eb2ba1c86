// Which pixels are an object: box, point, brush, eraser, outline, cut, join, a new entry, its label. One tool with a strip of ways
// over the photo; each way works with a mouse, a finger or the keyboard (arrows move a cursor, space presses).

import { picture } from "./api.js";
import { element, icon, isolated, part } from "./elements.js";
import { makeCover } from "./covers.js";

const WAYS = [
  { name: "box", label: "Box", icon: "M3 5h4v2H5v2H3zm14 0h4v4h-2V7h-2zM3 15h2v2h2v2H3zm16 0h2v4h-4v-2h2zM9 5h6v2H9zm0 12h6v2H9zM3 10.5h2v3H3zm16 0h2v3h-2z", hint: (name) => (name ? "Draw a box around the whole object" : "Draw a box around an object"), one: false },
  { name: "point", label: "Point", icon: "M11 2h2v5h-2zm0 15h2v5h-2zM2 11h5v2H2zm15 0h5v2h-5zM12 9.5a2.5 2.5 0 1 1 0 5 2.5 2.5 0 0 1 0-5", hint: (name) => (name ? "Click in its middle" : "Click on an object"), one: false },
  { name: "brush", label: "Brush", icon: "M20.7 3.3a1.5 1.5 0 0 0-2.1 0L9.5 12.4l2.1 2.1 9.1-9.1a1.5 1.5 0 0 0 0-2.1M8.2 13.5A3.5 3.5 0 0 0 4.7 17c0 1.2-.9 2-1.9 2.2.9 1.1 2.5 1.8 4 1.8a4 4 0 0 0 4-4 3.5 3.5 0 0 0-2.6-3.5", hint: () => "Paint what belongs to it", one: true },
  { name: "eraser", label: "Eraser", icon: "M15.1 3.6 3.6 15.1a2 2 0 0 0 0 2.8L6.7 21H21v-2h-8.3l7.7-7.7a2 2 0 0 0 0-2.8l-4.3-4.9a.7.7 0 0 0-1 0M9.5 12l4.5 4.5L10.5 19H7.5L5 16.5z", hint: () => "Erase what does not belong to it", one: true },
  { name: "polygon", label: "Outline", icon: "M12 2.5 21.5 9 18 20.5H6L2.5 9zm0 2.4L4.8 9.8l2.7 8.7h9l2.7-8.7z", hint: (name) => `Click its corners, then Enter or the first again${name ? "" : ": a new object"}`, one: false },
  { name: "split", label: "Cut", icon: "M5.5 3.5 20 18l-1.5 1.5L4 5zM6 14a3 3 0 1 1 0 6 3 3 0 0 1 0-6M18 4a3 3 0 1 1 0 6 3 3 0 0 1 0-6", hint: () => "Draw a line across it to make two objects", one: true },
  { name: "merge", label: "Join", icon: "M8 5a7 7 0 0 1 4 1.3A7 7 0 1 1 12 17.7 7 7 0 1 1 8 5m4 3.9a5 5 0 0 0 0 6.2 5 5 0 0 0 0-6.2", hint: () => "Click what belongs to it, too", one: true },
  { name: "new", label: "New object", icon: "M11 5h2v6h6v2h-6v6h-2v-6H5v-2h6z", hint: () => "Draw a box around an object that was not found", one: false },
];
const TINT = [64, 150, 255, 105], LINE = "rgb(255 255 255)", AIM = "rgb(255 220 90)";
const SMALLEST = 1, LARGEST = 200;

export function start(editor) {
  const stage = part("stage");
  let way = WAYS[0], radius = 12, cover = null, shown = null, wanted = 0, busy = 0;
  // in px of the photo; `aim` is where the hand or the keyboard is, `whose` what was chosen when it pressed
  let drag = null, corners = [], aim = null, down = false, whose = null;

  const chosen = () => (editor.selected?.kind === "object" ? editor.selected.name : null);
  const inUse = () => editor.tool?.name === "mask";
  const size = () => editor.stage.size();

  // ---- the strip over the photo
  const ways = element("div", { class: "mask-ways", role: "radiogroup", "aria-label": "Tools to correct a mask" }, ...WAYS.map((one, k) => element("button", {
    type: "button", role: "radio", "data-way": one.name, "aria-checked": "false", "aria-label": one.label, title: `${one.label} (${k + 1})`,
    on: { click: () => { take(one.name); stage.focus({ preventScroll: true }); } } }, icon(one.icon), element("span", { "aria-hidden": "true" }, one.label))));
  const slider = element("input", { type: "range", min: SMALLEST, max: 60, step: 1, value: radius, "aria-label": "Size of the brush, px", on: { input: () => resize(Number(slider.value)) } });
  const width = element("output", {}, "");
  const sizes = element("label", { class: "mask-size", title: "[ and ]" }, "Size", slider, width);
  const others = element("select", { "aria-label": "Join with" });
  const join = element("span", { class: "mask-join" }, others, element("button", { type: "button", class: "act", on: { click: () => others.value && merge(others.value) } }, "Join"));
  const label = element("input", { type: "text", list: "mask-labels", maxlength: 120, placeholder: "what is it?", "aria-label": "Label", spellcheck: "false", autocomplete: "off" });
  const labels = element("datalist", { id: "mask-labels" });
  const relabel = element("form", { class: "mask-label", on: { submit: (event) => { event.preventDefault(); named(); } } }, label, labels, element("button", { type: "submit", class: "act" }, "Label"));
  const words = element("p", { class: "mask-words", id: "mask-words" });
  const close = element("button", { type: "button", class: "act", hidden: true, on: { click: () => closed() } }, "Close the outline");
  const strip = element("div", { class: "mask-strip", hidden: true, "aria-label": "Masks", role: "group" }, ways, element("div", { class: "mask-row" }, words, sizes, join, close, relabel));
  const messages = part("status").parentElement;
  part("run").after(strip); // in the player's place, so that the photo stays where it is
  if (!stage.hasAttribute("tabindex")) stage.tabIndex = -1;

  function take(name) {
    cancel();
    way = WAYS.find((one) => one.name === name);
    drawn();
  }

  function drawn() {
    const name = chosen();
    if (strip.hidden && inUse()) strip.style.minHeight = `${part("run").offsetHeight}px`;
    strip.hidden = !inUse();
    part("run").hidden = inUse();
    const place = inUse() ? strip : part("run");
    if (messages.parentElement !== place) place.append(messages); // what is said is seen beside either
    stage.classList.toggle("masking", inUse());
    if (strip.hidden) return;
    for (const made of ways.children) {
      const own = made.dataset.way === way.name;
      made.setAttribute("aria-checked", String(own));
      made.tabIndex = own ? 0 : -1;
    }
    sizes.hidden = !["brush", "eraser"].includes(way.name);
    slider.value = Math.min(radius, 60);
    width.textContent = `${2 * radius} px`;
    join.hidden = way.name !== "merge" || !name;
    if (!join.hidden) others.replaceChildren(...Object.keys(editor.state?.scene?.objects ?? {}).filter((other) => other !== name).map((other) => element("option", { value: other }, other)));
    relabel.hidden = !name;
    if (document.activeElement !== label) label.value = (name && editor.state?.scene?.objects?.[name]?.label) ?? "";
    close.hidden = way.name !== "polygon" || corners.length < 3;
    strip.classList.toggle("busy", busy > 0);
    words.replaceChildren(...(busy ? [busy > 1 ? `Applying corrections, ${busy} to go …` : "Applying the correction …"] : !editor.state ? ["The scene is opening …"]
      : !editor.state.scene ? ["Fix the errors of the file first: see YAML"]
      : way.one && !name ? ["Choose an object first: click it"]
      : [...(name && way.name !== "new" ? [element("b", {}, isolated(name)), ": "] : []), way.hint(name)]));
  }

  function resize(to) {
    radius = Math.min(Math.max(to, SMALLEST), LARGEST);
    drawn();
    editor.redraw();
  }

  // ---- the mask of what is chosen
  async function load() {
    const name = chosen(), mine = (wanted += 1), [w] = size();
    if (!inUse() || !name || !editor.state?.scene || !w) { covers(null); return; }
    try {
      const where = new URLSearchParams({ object: name, ...(editor.variant ? { variant: editor.variant } : {}) });
      const address = await picture(`/api/mask?${where}`), image = new Image();
      image.src = address;
      await image.decode();
      URL.revokeObjectURL(address);
      if (mine !== wanted || busy) return;
      const found = makeCover(image.naturalWidth, image.naturalHeight);
      found.read(image);
      covers(found, name);
    } catch (refused) {
      if (mine === wanted) { covers(null); if (refused.status) editor.say(refused.message, "error"); }
    }
  }

  function covers(found, name = null) {
    [cover, shown] = [found, name];
    document.body.dataset.cover = name ?? "";
    editor.redraw();
  }

  async function ask(op, then = null) {
    const before = new Set(Object.keys(editor.state?.scene?.objects ?? {}));
    busy += 1;
    drawn();
    try {
      const state = await editor.maskOp(op);
      const found = state?.made ?? Object.keys(state?.scene?.objects ?? {}).find((name) => !before.has(name));
      if (found && op.kind !== "relabel") { editor.select(found); editor.say(`${found} is new: give it a label`); }
      else {
        if (state?.corrected && !chosen()) editor.select(state.corrected); // its mask shows what became of it
        editor.say(typeof then === "function" ? then(state) : then ?? (state?.corrected ? `The mask of ${state.corrected} is corrected` : "Corrected"));
      }
    } catch { /* reported by the editor */ } finally {
      busy -= 1;
    }
    drawn();
    load();
  }

  // ---- what the hand or the keyboard does: press at a point, move, release
  function press(point) {
    const name = chosen(), hit = under(point);
    if (!editor.state?.scene) return;
    aim = point;
    whose = name;
    if (way.one && !name) { if (hit?.kind === "object") editor.select(hit.name); return; }
    if (way.name === "brush" || way.name === "eraser") {
      down = true;
      drag = [point];
      paint(point, point);
    } else if (way.name === "point") pointed(point, hit?.kind === "object" ? hit.name : null);
    else if (way.name === "merge") { if (hit?.kind === "object" && hit.name !== name) merge(hit.name); }
    else if (way.name === "polygon") corner(point);
    else { down = true; drag = [point, point]; }
    editor.redraw();
  }

  // on another object that is known it chooses that one, on the chosen one it finds the mask again
  function pointed(point, known) {
    const name = chosen();
    if (known && known !== name) {
      editor.select(known);
      editor.say(`${known} is an object already: click it again to find its mask anew`);
    } else ask({ kind: "point", point: short(point), object: name });
  }

  function travel(point) {
    aim = point;
    if (down && drag) {
      if (way.name === "brush" || way.name === "eraser") {
        const last = drag[drag.length - 1];
        if (Math.hypot(point[0] - last[0], point[1] - last[1]) >= 0.5) { drag.push(point); paint(last, point); }
      } else drag[1] = point;
    }
    editor.redraw();
  }

  function release(point) {
    if (!down) return;
    travel(point);
    const made = drag, name = whose;
    down = false;
    drag = null;
    if (way.name === "brush" || way.name === "eraser") ask({ kind: way.name, object: name, strokes: made.map(short), radius });
    else if (way.name === "split") {
      if (Math.hypot(made[1][0] - made[0][0], made[1][1] - made[0][1]) >= 3) ask({ kind: "split", object: name, line: made.map(short) });
    } else {
      const [left, top] = [0, 1].map((k) => Math.min(made[0][k], made[1][k])), [w, h] = [0, 1].map((k) => Math.abs(made[0][k] - made[1][k]));
      if (w >= 3 && h >= 3) ask({ kind: way.name, box: [...short([left, top]), ...short([w, h])], object: way.name === "new" ? null : name });
      else if (way.name === "new") editor.say("Draw a larger box");
      else if (under(point)?.kind === "object") editor.select(under(point).name); // a click chooses
      else if (!name) editor.say("Draw a larger box");
    }
    editor.redraw();
  }

  function paint(from, to) {
    if (cover && shown === chosen()) cover.stroke(from, to, radius, way.name === "brush" ? 1 : 0);
  }

  function corner(point) {
    const first = corners[0];
    if (first && corners.length >= 3 && Math.hypot(point[0] - first[0], point[1] - first[1]) * scale() < 10) return closed();
    corners.push(point);
    drawn();
  }

  function closed() {
    const made = corners;
    corners = [];
    drawn();
    editor.redraw();
    if (made.length >= 3) ask({ kind: "polygon", polygon: made.map(short), object: chosen() });
  }

  const merge = (other) => ask({ kind: "merge", objects: [chosen(), other] }, `${other} is part of ${chosen()} now`);

  async function named() {
    const name = chosen(), text = label.value.trim();
    stage.focus({ preventScroll: true }); // keys are the tools' again
    if (!name || text === (editor.state.scene.objects[name].label ?? "")) return;
    const numbers = ({ scene }) => JSON.stringify(["mass", "density", "friction", "elasticity", "rolling"].map((key) => scene?.objects[name]?.[key])), before = numbers(editor.state);
    await ask({ kind: "relabel", object: name, label: text }, (state) => (numbers(state) === before ? `${name} is a ${text}: its numbers are unchanged` : `${name} is a ${text}: its numbers were updated`));
  }

  function cancel() {
    const open = drag !== null || corners.length > 0;
    if (drag && cover && ["brush", "eraser"].includes(way.name)) load();
    drag = null;
    down = false;
    corners = [];
    drawn();
    editor.redraw?.();
    return open;
  }

  const scale = () => editor.stage.view.scale;
  const short = (point) => point.map((value) => Number(value.toFixed(1)));

  editor.registerTool({
    name: "mask", label: "Correct masks", short: "Mask", key: "m", cursor: "crosshair",
    icon: "M12 3a9 9 0 0 0-9 9 9 9 0 0 0 9 9zm0 2v14a7 7 0 0 1-7-7 7 7 0 0 1 7-7m2-1.8V5.2A7 7 0 0 1 19 12a7 7 0 0 1-5 6.7v2.1A9 9 0 0 0 21 12a9 9 0 0 0-7-8.8",
    photo: true, // masks are those of the photo, wherever an object is put
    down: press, move: (point) => travel(point), up: (point) => release(point), cancel, draw,
  });

  // ---- the drawing over the photo
  function draw(context, pen) {
    if (cover && shown === chosen()) cover.draw(context, pen, TINT, LINE);
    const line = (points, shut) => { const path = new Path2D(); points.forEach(([x, y], k) => (k ? path.lineTo(x, y) : path.moveTo(x, y))); if (shut) path.closePath(); return path; };
    if (corners.length) {
      pen.stroke(line([...corners, ...(aim ? [aim] : [])]), AIM, 1.6);
      for (const [x, y] of corners) { const dot = new Path2D(); dot.arc(x, y, 3.5 * pen.unit, 0, 2 * Math.PI); pen.fill(dot, AIM); }
    }
    if (drag && way.name === "split") pen.stroke(line(drag), AIM, 2, 1, [7, 5]);
    else if (drag && (way.name === "box" || way.name === "new")) {
      const [[x0, y0], [x1, y1]] = drag;
      pen.stroke(line([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], true), AIM, 1.8);
    }
    if (!aim) return;
    const path = new Path2D();
    if (way.name === "brush" || way.name === "eraser") {
      path.arc(aim[0], aim[1], radius, 0, 2 * Math.PI);
      pen.stroke(path, way.name === "brush" ? LINE : AIM, 1.4, 1, way.name === "eraser" ? [4, 3] : []);
    } else if (byKey) {
      for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) { path.moveTo(aim[0] + 4 * dx * pen.unit, aim[1] + 4 * dy * pen.unit); path.lineTo(aim[0] + 12 * dx * pen.unit, aim[1] + 12 * dy * pen.unit); }
      pen.stroke(path, AIM, 2);
    }
  }

  // ---- keys, while the focus is on the photo
  let byKey = false, saying = 0;
  stage.addEventListener("pointermove", () => { byKey = false; }, true);
  addEventListener("keydown", (event) => {
    const { target, key } = event;
    if (!inUse() || event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]")) return;
    if (ways.contains(target) && /^Arrow/.test(key)) {
      const by = key === "ArrowRight" || key === "ArrowDown" ? 1 : -1, at = WAYS.indexOf(way);
      take(WAYS[(at + by + WAYS.length) % WAYS.length].name);
      ways.querySelector("[aria-checked=true]").focus();
    } else if (/^[1-8]$/.test(key) && !takesText(target)) take(WAYS[Number(key) - 1].name);
    else if ((key === "[" || key === "]") && !takesText(target)) resize(Math.round(key === "]" ? Math.max(radius + 1, radius * 1.2) : Math.min(radius - 1, radius / 1.2)));
    else if (target !== document.body && target !== stage && !(stage.contains(target) && target.matches("canvas"))) return;
    else if (/^Arrow/.test(key)) steer(key, event.shiftKey ? 10 : 1);
    else if (key === " ") {
      byKey = true;
      aim ??= middle();
      if (down) release(aim); else press(aim);
      if (down) editor.say(`${way.label} down`);
    } else if (key === "Enter" && way.name === "polygon") closed();
    else if (key === "Escape") { if (!cancel()) return; } else return;
    event.preventDefault();
    event.stopImmediatePropagation();
  }, true);

  function steer(key, by) {
    const [w, h] = size(), [x, y] = aim ?? middle();
    byKey = true;
    travel([Math.min(Math.max(x + by * ({ ArrowRight: 1, ArrowLeft: -1 }[key] ?? 0), 0), w - 1), Math.min(Math.max(y + by * ({ ArrowDown: 1, ArrowUp: -1 }[key] ?? 0), 0), h - 1)]);
    clearTimeout(saying);
    saying = setTimeout(() => editor.say(`${Math.round(aim[0])}, ${Math.round(aim[1])}${shown ? (cover.has(...aim) ? `, in ${shown}` : `, beside ${shown}`) : ""}`), 350);
  }

  const middle = () => { const made = editor.state?.derived?.objects?.[chosen()]; return made ? made.centre.map(Math.round) : size().map((side) => Math.round(side / 2)); };
  const under = (point) => editor.stage.hit(point, { kinds: ["object"] });

  editor.on("tool", () => { aim = null; if (inUse()) editor.player?.rewind?.(); drawn(); load(); });
  editor.on("select", () => { corners = []; drawn(); load(); });
  let maps = null;
  editor.on("state", ({ state }) => {
    labels.replaceChildren(...labelled(editor.materials).map((text) => element("option", { value: text })));
    drawn();
    const now = `${state.version} ${state.variant}`;
    if (now !== maps && !busy && !drag) load();
    maps = now;
  });
}

// whether letters and digits are typed into it
const takesText = (target) => target.matches?.("input:not([type=range]), textarea, select, [contenteditable]") ?? false;

// the table of materials, in whatever shape it comes -> names
function labelled(table) {
  const rows = Array.isArray(table) ? table : [...(table?.objects ?? []), ...(table?.materials ?? [])];
  return rows.map((row) => (typeof row === "string" ? row : row.name ?? row.label)).filter(Boolean);
}
