// The photo on a canvas that can be moved and enlarged, the scene over it, and whoever points at something of it.

import { part } from "./elements.js";
import { same } from "./app.js";
import { makeHits } from "./hits.js";
import { makePictures } from "./pictures.js";

export const INKS = {
  accent: "#ffd23f",
  velocity: "#28e1a5",
  force: "#ff7a3d",
  light: "#ffe9a8",
  wall: "#f096c3",
  joint: "#96e85a",
  field: "#ffac50",
};
const MARGIN = 20,
  TOP = 78, // px: under the strip of a tool and the light
  LARGEST = 1600,
  DIMMED = 0.22; // of paths while another object is chosen

export function start(editor) {
  const stage = part("stage"),
    scene = part("scene"),
    over = part("over"),
    context = over.getContext("2d");
  const view = { scale: 1, x: 0, y: 0, fitted: true };
  const hits = makeHits(editor, view),
    { hit, outline, pathOf } = hits;
  let painted = null,
    hovered = null,
    due = false,
    space = false;
  const fingers = new Map();
  let pinch = null,
    panned = null,
    held = null;

  const size = () =>
    editor.player?.run?.data.size ||
    editor.state?.derived?.size ||
    editor.state?.scene?.size ||
    (pictures.photo ? [pictures.photo.width, pictures.photo.height] : [512, 512]);
  const api = (editor.stage = {
    view,
    redraw,
    size,
    drawn: () => pictures.whole,
    photo: () => pictures.photo,
    whenPhoto: (draw) => waiting.push(draw),
    repaint() {
      painted = null;
      redraw();
    },
    get unit() {
      return 1 / view.scale;
    }, // px of the photo that a px of the screen is
    point(event) {
      const box = over.getBoundingClientRect();
      return [(event.clientX - box.left - view.x) / view.scale - 0.5, (event.clientY - box.top - view.y) / view.scale - 0.5];
    },
    screen: ([x, y]) => [(x + 0.5) * view.scale + view.x, (y + 0.5) * view.scale + view.y],
    ...hits,
    zoom,
    fit,
    get hovered() {
      return hovered;
    },
    hover(entry) {
      if (!same(entry, hovered)) {
        hovered = entry;
        redraw();
      }
    },
    pan(dx, dy) {
      view.x += dx;
      view.y += dy;
      view.fitted = false;
      place();
    },
  });

  const waiting = []; // drawings that need the photo
  const pictures = makePictures(editor, () => {
    painted = null;
    if (pictures.photo) for (const draw of waiting.splice(0)) draw();
    if (view.fitted) fit();
    else redraw();
  });

  // ---- where the photo is
  function fit() {
    const [w, h] = size(),
      box = stage.getBoundingClientRect();
    const tools = document.querySelector(".zoom"),
      below = tools.offsetTop > box.height / 2 ? box.height - tools.offsetTop : 0; // a phone has them there
    const high = box.height - TOP - Math.max(MARGIN, below + 8);
    view.scale = Math.max(0.05, Math.min((box.width - 2 * MARGIN) / w, high / h));
    view.x = (box.width - w * view.scale) / 2;
    view.y = TOP + (high - h * view.scale) / 2;
    view.fitted = true;
    place();
  }
  function zoom(by, [cx, cy] = [stage.clientWidth / 2, stage.clientHeight / 2]) {
    const scale = clamp(view.scale * by, 0.05, 40),
      larger = scale / view.scale;
    view.x = cx - (cx - view.x) * larger;
    view.y = cy - (cy - view.y) * larger;
    view.scale = scale;
    view.fitted = false;
    place();
  }
  function place() {
    const [w, h] = size(),
      dense = Math.min(devicePixelRatio || 1, 2);
    const wide = Math.max(1, Math.round(Math.min(w * view.scale * dense, LARGEST, Math.max(w, 800) * dense))),
      tall = Math.max(1, Math.round((wide * h) / w));
    if (scene.width !== wide || scene.height !== tall) {
      scene.width = wide;
      scene.height = tall;
      painted = null;
    }
    scene.style.width = `${w * view.scale}px`;
    scene.style.height = `${h * view.scale}px`;
    scene.style.transform = `translate(${view.x}px, ${view.y}px)`;
    const width = Math.round(stage.clientWidth * dense),
      height = Math.round(stage.clientHeight * dense);
    if (over.width !== width || over.height !== height) {
      over.width = width;
      over.height = height;
    }
    redraw();
    editor.emit("view", view);
  }
  new ResizeObserver(() => (view.fitted ? fit() : place())).observe(stage);

  editor.on("state", ({ state }) => {
    stage.classList.toggle("stale", !state.motion);
    part("stale").hidden = Boolean(state.motion);
    part("stale").textContent = editor.player.run ? "The file has an error: the last valid scene is shown." : "The file has an error: see YAML.";
    redraw();
  });
  editor.on("motion", () => {
    if (view.fitted) fit();
  });
  for (const event of ["select", "tool", "preview"]) editor.on(event, redraw);

  // ---- drawing
  function redraw() {
    if (due) return;
    due = true;
    requestAnimationFrame(() => {
      due = false;
      draw();
    });
  }
  function draw() {
    const { run, shown } = editor.player || {},
      now = run && editor.player.now();
    const key = now && `${now.time} ${shown.has("shadows")} ${editor.tool?.name === "mask"}`;
    if (key !== painted || !run) {
      painted = key;
      const ink = scene.getContext("2d"),
        large = scene.width / size()[0];
      ink.setTransform(large, 0, 0, large, 0.5 * large, 0.5 * large);
      ink.imageSmoothingQuality = "medium";
      const hidden = new Set([...(editor.hidden || [])].map((name) => run?.index.get(name)));
      pictures.draw(ink, now && { ...now, hidden }, size(), shown?.has("shadows"));
    }
    const dense = over.width / (stage.clientWidth || 1),
      large = view.scale * dense;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, over.width, over.height);
    context.setTransform(large, 0, 0, large, view.x * dense + 0.5 * large, view.y * dense + 0.5 * large);
    const pen = makePen(context, view.scale);
    pen.context = context;
    if (run) {
      if (shown.has("ways") && !editor.player.playing) ways(pen);
      if (editor.player.other) ghost(pen, editor.player.other, now);
      else if (shown.has("before") && editor.player.before) ghost(pen, editor.player.trying ? editor.player.own : editor.player.before, now);
      const hidden = new Set([...(editor.hidden || [])].map((name) => run.index.get(name)));
      for (const layer of run.layers) if (shown.has(layer.id)) layer.draw(pen, { ...now, hidden });
      if (shown.has("masses"))
        run.data.bodies.forEach((body, k) => {
          if (body.motion === "dynamic") pen.words(run.units.grams(body.mass), now.poses[k].x, now.poses[k].y, "#fff", { size: 11 });
        });
    }
    if (run && !editor.player.playing) warnings(pen);
    for (const overlay of editor.overlays) overlay(context, pen, now);
    for (const [entry, strong] of [
      [hovered, false],
      [editor.selected, true],
    ])
      if (entry && (strong || !same(entry, editor.selected))) mark(pen, entry, strong);
    editor.tool?.draw?.(context, pen, now);
    over.dataset.drawn = String((+over.dataset.drawn || 0) + 1);
  }
  // where each centre goes, all of it, with the outlines of a few moments while an edit is tried
  function ways(pen) {
    const { run, before, trying } = editor.player,
      none = run.motion.times.length < 2;
    if (none) return;
    const line = (motion, body) => {
      const points = [[body.x[0], body.y[0]]];
      for (let i = 1; i < motion.times.length; i += 1) {
        const [x, y] = points[points.length - 1];
        if (Math.hypot(body.x[i] - x, body.y[i] - y) > 1.5 * pen.unit) points.push([body.x[i], body.y[i]]);
      }
      return points;
    };
    const many = run.motion.bodies.length > 24;
    if (shownBefore())
      for (const body of before.motion.bodies) {
        const mine = run.index.get(body.name),
          points = line(before.motion, body);
        if (mine === undefined || points.length < 2 || many) continue;
        pen.stroke(lineOf(points), "#c4c8d2", 1, 0.45, [3, 5]);
      }
    run.motion.bodies.forEach((body, k) => {
      const points = line(run.motion, body),
        mine = editor.selected?.kind === "object" && editor.selected.name === body.name;
      if (points.length < 2) return;
      if (editor.hidden?.has(body.name)) return;
      const others = editor.selected?.kind === "object" ? DIMMED : many ? 0.4 : 0.7; // paths of the others step back
      pen.stroke(lineOf(points), OBJECTS[k % OBJECTS.length], mine ? 1.8 : 1.2, mine ? 1 : others);
      if (!trying || !mine) return;
      for (let step = 1; step <= 6; step += 1) {
        const pose = run.motion.pose(body, run.motion.locate((run.motion.end * step) / 6));
        context.globalAlpha = 0.5;
        pen.line(pathOf(run, k, pose), OBJECTS[k % OBJECTS.length], 1, 0.55);
      }
    });
    context.globalAlpha = 1;
  }
  const shownBefore = () => editor.player.shown.has("before") && editor.player.before;
  // outlines of the run before, where they are elsewhere now
  function ghost(pen, run, now) {
    if (!run || run === editor.player.run) return;
    const then = editor.player.at(run, now.time);
    run.motion.bodies.forEach((body, k) => {
      const mine = editor.player.run.index.get(body.name),
        a = then.poses[k],
        b = mine !== undefined && now.poses[mine];
      if (b && Math.hypot(a.x - b.x, a.y - b.y) < 1.5 && Math.abs(a.a - b.a) < 0.03) return;
      pen.stroke(pathOf(run, k, a), "#e7e9ec", 1.2, 0.75, [4, 4]);
    });
  }
  // warnings are shown at the object that is meant
  function warnings(pen) {
    const { run } = editor.player,
      odd = new Set((editor.state.problems || []).map((problem) => problem.object).filter(Boolean));
    for (const name of odd) {
      const [ring] = run.index.has(name) ? hits.ringsOf(name) : [];
      if (!ring) continue;
      const [x, y] = ring.reduce((best, p) => (p[0] - p[1] > best[0] - best[1] ? p : best));
      pen.words("!", x, y, "#ffd23f", { size: 13 });
    }
  }
  function mark(pen, entry, strong) {
    const path = outline(entry);
    if (!path) return;
    if (strong && entry.kind === "object") pen.fill(path, INKS.accent, 0.1);
    pen.stroke(path, INKS.accent, strong ? 3 : 2, strong ? 1 : 0.8);
  }

  // ---- pointers: one goes to the tool; the middle button, space or two fingers move the photo
  const local = (event) => {
    const box = over.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  over.addEventListener("pointerdown", (event) => {
    fingers.set(event.pointerId, local(event));
    over.setPointerCapture(event.pointerId);
    if (fingers.size === 2) {
      if (held !== null) {
        editor.tool?.cancel?.();
        held = null;
      }
      const [a, b] = [...fingers.values()];
      pinch = { far: Math.hypot(a[0] - b[0], a[1] - b[1]), middle: [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2] };
      return;
    }
    if (event.button === 1 || space) {
      panned = local(event);
      event.preventDefault();
      return;
    }
    if (event.button !== 0 || !editor.state) return;
    if (!editor.state.scene) {
      editor.say("The file has an error: the last valid scene is shown; fix the text first, see YAML");
      return;
    }
    const point = api.point(event);
    held = event.pointerId;
    editor.tool?.down?.(point, event, grabbed(point, { finger: event.pointerType === "touch" }));
    over.focus({ preventScroll: true });
  });
  // A run that the page plays by itself gives way to the hand: it goes back to the beginning, and what is there is taken;
  // where nothing is, the run stops and what was seen there is.
  function grabbed(point, how) {
    const { player } = editor;
    if (!player.showing) return hit(point, how);
    const { time } = player,
      seen = hit(point, how);
    player.rewind();
    const found = hit(point, how);
    if (found?.kind === "object" || seen?.kind !== "object") return found;
    player.seek(time);
    return seen;
  }
  over.addEventListener("pointermove", (event) => {
    if (fingers.has(event.pointerId)) fingers.set(event.pointerId, local(event));
    if (pinch && fingers.size >= 2) {
      const [a, b] = [...fingers.values()],
        far = Math.hypot(a[0] - b[0], a[1] - b[1]),
        middle = [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
      api.pan(middle[0] - pinch.middle[0], middle[1] - pinch.middle[1]);
      zoom(far / Math.max(pinch.far, 1), middle);
      pinch = { far, middle };
      return;
    }
    if (panned) {
      const now = local(event);
      api.pan(now[0] - panned[0], now[1] - panned[1]);
      panned = now;
      return;
    }
    const point = api.point(event);
    if (held === null && event.pointerType !== "touch") api.hover(hit(point));
    if (held === null || held === event.pointerId) editor.tool?.move?.(point, event, hovered);
    over.style.cursor = space || panned ? "grab" : editor.tool?.cursorAt?.(point) || editor.tool?.cursor || "default";
  });
  function released(event) {
    fingers.delete(event.pointerId);
    if (fingers.size < 2) pinch = null;
    panned = null;
    if (held !== event.pointerId) return;
    held = null;
    if (event.type === "pointercancel") editor.tool?.cancel?.();
    else editor.tool?.up?.(api.point(event), event);
  }
  over.addEventListener("pointerup", released);
  over.addEventListener("pointercancel", released);
  over.addEventListener("pointerleave", () => {
    if (held === null) api.hover(null);
  });
  over.addEventListener("dblclick", (event) => editor.tool?.double?.(api.point(event), event));
  over.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      if (event.shiftKey) api.pan(-event.deltaY - event.deltaX, 0);
      else zoom(Math.exp(-clamp(event.deltaY * (event.deltaMode ? 16 : 1), -200, 200) / 400), local(event));
    },
    { passive: false },
  );
  addEventListener("keydown", (event) => {
    if (event.key === " " && document.activeElement === over) space = true;
  });
  addEventListener("keyup", (event) => {
    if (event.key === " ") space = false;
  });
  part("closer").addEventListener("click", () => zoom(1.4));
  part("farther").addEventListener("click", () => zoom(1 / 1.4));
  part("fit").addEventListener("click", fit);
}
