// A drag from press to release: tried on the server while it lasts, made as one edit when it ends; and what it writes.

const STEPS = [1, 2, 5];
export const PAUSE = 2000; // ms, after which a key that is pressed again begins another step

// the least of 1, 2, 5, 10, 20 ... that is not below a positive value
export function roundAbove(value) {
  const power = 10 ** Math.floor(Math.log10(value) + 1e-12);
  return (STEPS.find((k) => k * power >= value * (1 - 1e-9)) || 10) * power;
}
// numbers as a person would write them: whole multiples of a round step
export const rounded = (value, step) => +(Math.round(value / step) * step).toPrecision(12);
export const point2 = (point, step) => point.map((v) => rounded(v, step));
// px of the photo that are worth writing at the zoom that is shown
export const pixel = (editor) => Math.min(roundAbove(editor.stage.unit / 2), 1);

export const written = (editor, path) => editor.state?.scene?.written?.includes(path.join(".").replace(/\.(\d+)(?=\.|$)/g, "[$1]"));

// to set a value by hand: its `from` no longer holds
export function setting(editor, path, value) {
  const ops = [{ set: path, value }],
    [section, name, key] = path;
  if (editor.variant || path.length < 2) return ops;
  const item = section === "light" ? editor.state.scene.light : editor.state.scene[section]?.[name];
  const from = item?.from;
  if (typeof from === "string") {
    if (section === "light" ? name === "direction" : ["segment", "polyline"].includes(key))
      ops.push({ unset: [...(section === "light" ? ["light"] : [section, name]), "from"] });
  } else if (from && key in from) {
    ops.push({ unset: Object.keys(from).length > 1 ? [section, name, "from", key] : [section, name, "from"] });
  }
  return ops;
}

// drags are {to(point, event) -> ops or null, describe() -> what the edit is, click()?, done()?}
export function makeDragging(editor) {
  let drag = null,
    from = null,
    moved = false,
    ops = null;
  return {
    get drag() {
      return drag;
    },
    get moved() {
      return moved;
    },
    begin(next, point) {
      [drag, from, moved, ops] = [next, point, false, null];
      return true;
    },
    move(point, event) {
      if (!drag) return false;
      if (!moved && Math.hypot(point[0] - from[0], point[1] - from[1]) < 4 / editor.stage.view.scale) return true;
      if (!moved) drag.first?.();
      moved = true;
      ops = drag.to(point, event);
      if (ops && drag.tried !== false) editor.preview(ops);
      editor.redraw();
      return true;
    },
    async up() {
      if (!drag) return;
      const done = drag,
        made = ops,
        was = moved;
      drag = null;
      editor.redraw();
      if (!was) {
        done.click?.();
        return;
      }
      if (!made) {
        editor.preview(null);
        return;
      }
      const what = done.describe();
      try {
        await editor.edit(made, what);
        editor.say(what);
        done.done?.();
      } catch {
        editor.preview(null);
      }
    },
    cancel() {
      if (!drag) return false;
      drag = null;
      editor.preview(null);
      editor.redraw();
      return true;
    },
  };
}

// Keys that are held: what comes while an edit is under way is added up, and made on what is there then.
// add(key, vector, made(vector) -> {ops, what, tag} or null)
export function makeRepeated(editor) {
  let waiting = null,
    busy = false,
    gesture = 0,
    last = 0;
  async function run() {
    busy = true;
    while (waiting) {
      const { vector, made } = waiting;
      waiting = null;
      const edit = made(vector);
      if (!edit?.ops) continue;
      try {
        await editor.edit(edit.ops, edit.what, `${edit.tag} ${editor.variant ?? ""} ${gesture}`);
        editor.say(edit.what);
      } catch {
        waiting = null;
      }
    }
    busy = false;
  }
  return (key, vector, made) => {
    const now = performance.now();
    if (now - last > PAUSE) gesture += 1; // after a pause it is another step
    last = now;
    waiting = { key, vector: waiting?.key === key ? vector.map((v, k) => v + waiting.vector[k]) : vector, made };
    if (!busy) run();
    return true;
  };
}
