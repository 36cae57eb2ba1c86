// Rows of the panels: one key of the scene each, with its unit, its range from the schema, its source, and a way back.

import { element, icon } from "./elements.js";
import { PAUSE, roundAbove, setting, written } from "./dragging.js";

const BACK = "M12 5V2L7 6.5 12 11V8a5 5 0 1 1-5 5H4a8 8 0 1 0 8-8z";
const DOUBT = 0.6,
  DRAG = 4; // px of a drag that are one step
let schema = null,
  count = 0;

export async function loadSchema() {
  schema ||= await (await fetch("/static/scene-1.schema.json")).json();
}
const DEFS = { objects: "object", boundaries: "boundary", forces: "force", joints: "joint", fields: "field" };

// the schema's words of a path
export function specOf(path) {
  let spec = null;
  const [section, , ...rest] = path;
  let keys = rest;
  if (DEFS[section]) spec = schema?.$defs?.[DEFS[section]];
  else {
    spec = schema?.properties?.[section];
    keys = path.slice(1);
  }
  for (const key of keys) {
    spec = spec?.$ref ? resolved(spec) : spec;
    spec = spec?.properties?.[key] ?? spec?.additionalProperties;
  }
  return resolved(spec) || {};
}
const resolved = (spec) => (spec?.$ref ? { ...schema.$defs[spec.$ref.split("/").pop()], ...spec } : spec);

const short = (value) => (typeof value === "number" ? String(+value.toPrecision(7)) : (value ?? ""));
const SHOWN = { degrees: "°", "degrees/s": "°/s" };
export const valueAt = (root, path) => path.reduce((item, key) => item?.[key], root);

function ranged({ minimum: low, maximum: high, exclusiveMinimum: above }) {
  const top = high !== undefined && high <= 1e5 ? high : null;
  if (above !== undefined) return `more than ${above}${top !== null ? `, at most ${top}` : ""}`;
  if (low !== undefined && low > -1e5) return top !== null ? `${low} to ${top}` : `at least ${low}`;
  return top !== null ? `at most ${top}` : "";
}

// path: keys of the scene; name: the row's word; options: {spec, choices, says(value) -> words below, edits(value) -> ops,
// whole: the path that is written, if the row shows an item of a list}
export function makeRow(editor, path, name, options = {}) {
  const spec = options.spec || specOf(path),
    id = `row-${(count += 1)}`,
    unit = options.unit ?? SHOWN[spec["x-unit"]] ?? spec["x-unit"] ?? "";
  const vector = Boolean(spec.prefixItems) && options.kind !== "choice";
  const choices = options.choices || spec.enum,
    many = vector ? spec.prefixItems.length : 1;
  const scene = () => editor.state?.scene;
  const get = () => valueAt(scene(), path);
  const ops = (value) => (options.edits ? options.edits(value) : value === null ? [{ unset: path }] : setting(editor, path, value));
  const called = options.called || path.filter((key) => !["objects", "boundaries", "joints", "fields", "world"].includes(key)).join(" ");
  let gesture = 0,
    pressed = -Infinity;
  const note = element("p.note", { id: `${id}-note`, hidden: true });
  let last = null;

  const parse = (text) => {
    const words = text.trim().replace(",", ".").replace("−", "-");
    if (words === "") return null;
    const value = Number(words);
    if (!Number.isFinite(value)) return { wrong: "is not a number" };
    if (spec.type === "integer" && !Number.isInteger(value)) return { wrong: "is not a whole number" };
    const low = spec.minimum,
      high = spec.maximum,
      above = spec.exclusiveMinimum;
    if ((low !== undefined && value < low) || (high !== undefined && value > high) || (above !== undefined && value <= above))
      return { wrong: `is out of range: ${ranged(spec)}` };
    return value;
  };
  const kind = options.kind || (choices ? "choice" : spec.type === "boolean" ? "check" : spec.type === "string" ? "text" : "number");
  let inputs;
  if (kind === "choice")
    inputs = [
      element(
        "select",
        { id, "aria-describedby": note.id },
        ...(options.none ? [element("option", { value: "" }, options.none)] : []),
        ...choices.map((c) => element("option", { value: c.value ?? c }, c.name ?? c)),
      ),
    ];
  else if (kind === "check") inputs = [element("input", { id, type: "checkbox" })];
  else
    inputs = Array.from({ length: many }, (_, k) =>
      element("input", {
        id: k ? `${id}-${k}` : id,
        type: "text",
        inputmode: kind === "number" ? "decimal" : "text",
        autocomplete: "off",
        spellcheck: false,
        "aria-describedby": note.id,
        "aria-label": many > 1 ? `${name}, ${["x", "y", "z"][k]}` : null,
        maxlength: kind === "text" ? spec.maxLength || 200 : 40,
      }),
    );
  const read = () => {
    if (kind === "choice") return inputs[0].value === "" ? null : inputs[0].value;
    if (kind === "check") return inputs[0].checked;
    if (kind === "text") return inputs[0].value.trim() || null;
    const values = inputs.map((input) => parse(input.value));
    inputs.forEach((input, k) => input.setAttribute("aria-invalid", Boolean(values[k]?.wrong)));
    const wrong = values.find((v) => v?.wrong);
    if (wrong) return wrong;
    if (many === 1) return values[0];
    return values.every((v) => v === null) ? null : values.map((v) => v ?? 0);
  };
  const same = (one, other) => JSON.stringify(one ?? null) === JSON.stringify(other ?? null);
  const shown = () => (options.get ? options.get() : get()) ?? (options.fallback ? options.fallback() : spec.default);
  function fill(force = false) {
    const value = shown();
    inputs.forEach((input, k) => {
      if (!force && document.activeElement === input && input.dataset.touched) return;
      if (kind === "check") input.checked = Boolean(value);
      else input.value = many > 1 ? short(value?.[k]) : short(value);
      input.removeAttribute("aria-invalid");
      delete input.dataset.touched;
    });
    if (kind === "number" && !get())
      inputs.forEach((input) => {
        if (input.value === "") input.placeholder = options.placeholder?.()?.toString() || "";
      });
    last = null;
    say();
  }
  function say() {
    const value = read(),
      item = path[0] === "objects" ? scene()?.objects?.[path[1]] : null,
      from = item?.from?.[path[2]];
    const sure = from && +from.split(" ").at(-1),
      focused = row.contains(document.activeElement);
    note.className = "note";
    let words = "";
    if (value?.wrong) {
      words = `It ${value.wrong}.`;
      note.classList.add("wrong");
    } else if (from) {
      const who = Number.isFinite(sure) ? from.split(" ").slice(0, -1).join(" ") : from;
      words = `source: ${who}${Number.isFinite(sure) ? `, ${Math.round(100 * sure)} % sure` : ""}`;
      if (sure < DOUBT) note.classList.add("doubt");
    } else words = options.says?.(shown()) || "";
    if (focused && kind === "number" && !value?.wrong) words = [words, ranged(spec)].filter(Boolean).join(" · ");
    note.textContent = words;
    note.hidden = !words;
    back.disabled = options.required || !written(editor, options.whole || path);
  }
  function tried() {
    const value = read();
    say();
    if (value?.wrong || (value === null && options.required)) {
      editor.preview(null);
      return;
    }
    if (kind === "number" && value !== null) editor.preview(ops(value));
  }
  // keys that are held are one step; whatever is entered otherwise is a step of its own
  function commit(value = read(), tag = null) {
    inputs.forEach((input) => delete input.dataset.touched);
    if (value?.wrong) {
      say();
      return;
    }
    if (value === null && (options.required || !written(editor, options.whole || path))) {
      editor.preview(null);
      fill(true);
      return;
    }
    if (same(value, get()) || (last && same(value, last.value))) {
      editor.preview(null);
      return;
    }
    last = { value };
    editor
      .edit(
        ops(value),
        `${called}: ${value === null ? "back to the default" : Array.isArray(value) ? value.map(short).join(", ") : short(value)}${unit && value !== null ? ` ${unit}` : ""}`,
        tag,
      )
      .catch(() => fill(true));
  }
  const back = element(
    "button.back",
    { type: "button", "aria-label": `${name}: back to the default`, title: "Back to the default", on: { click: () => commit(null) } },
    icon(BACK),
  );
  for (const input of inputs) {
    input.addEventListener("input", () => {
      input.dataset.touched = "true";
      tried();
    });
    input.addEventListener("change", () => commit());
    input.addEventListener("focus", say);
    input.addEventListener("blur", () => setTimeout(say));
    input.addEventListener("keydown", (event) => {
      if (event.key === "Escape" && input.dataset.touched) {
        delete input.dataset.touched;
        editor.preview(null);
        fill(true);
        event.stopPropagation();
        event.preventDefault();
      }
      const by = { ArrowUp: 1, ArrowDown: -1 }[event.key];
      if (by && kind === "number") {
        const now = parse(input.value),
          value = typeof now === "number" ? now : 0;
        const step = spec.type === "integer" ? 1 : options.step || (spec.maximum <= 1 ? 0.05 : roundAbove(Math.max(Math.abs(value) * 0.04, 1e-3)));
        const low = spec.minimum ?? (spec.exclusiveMinimum !== undefined ? step : -Infinity);
        input.value = short(+Math.min(Math.max(value + by * step * (event.shiftKey ? 10 : 1), low), spec.maximum ?? Infinity).toPrecision(6));
        if (event.timeStamp - pressed > PAUSE) gesture += 1;
        pressed = event.timeStamp;
        commit(read(), `row ${path.join(".")} ${editor.variant ?? ""} ${gesture}`);
        event.preventDefault();
      }
    });
  }
  // a number that is pressed and dragged sideways changes by steps; the motion follows, and one edit is made at the end
  if (kind === "number")
    for (const input of inputs) {
      let from = null,
        before = 0,
        dragging = false;
      input.classList.add("dragged");
      const stepOf = (value) => (spec.type === "integer" ? 1 : options.step || (spec.maximum <= 1 ? 0.01 : roundAbove(Math.max(Math.abs(value) * 0.01, 1e-3))));
      input.addEventListener("pointerdown", (event) => {
        const now = parse(input.value || input.placeholder);
        if (document.activeElement === input || event.button !== 0 || typeof now !== "number") return;
        [from, before, dragging] = [event.clientX, now, false];
        input.setPointerCapture(event.pointerId);
      });
      input.addEventListener("pointermove", (event) => {
        if (from === null || (!dragging && Math.abs(event.clientX - from) < DRAG)) return;
        dragging = true;
        const step = stepOf(before), low = spec.minimum ?? (spec.exclusiveMinimum !== undefined ? step : -Infinity);
        const value = before + step * Math.round((event.clientX - from) / DRAG);
        input.value = short(+Math.min(Math.max(value, low), spec.maximum ?? Infinity).toPrecision(6));
        input.dataset.touched = "true";
        tried();
        event.preventDefault();
      });
      const end = (event) => {
        const done = from !== null && dragging;
        from = null;
        if (!done) return;
        if (event.type === "pointercancel") {
          editor.preview(null);
          fill(true);
        } else commit();
        input.blur();
      };
      input.addEventListener("pointerup", end);
      input.addEventListener("pointercancel", end);
    }
  const row = element(
    "div.row",
    { "data-row": path.join(".") },
    element(many > 1 ? "span.name" : "label", many > 1 ? { title: spec.description } : { for: id, title: spec.description }, name),
    element("div.of", {}, ...inputs, unit && element("span.unit", {}, unit)),
    back,
    note,
  );
  fill(true);
  return { row, fill };
}
