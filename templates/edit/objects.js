// The list of objects: a picture of each in its outline's colour, shown or hidden, locked or not, searched, several at once.

import { button, element, icon, isolated } from "./elements.js";
import { setting } from "./dragging.js";

const MANY = 6; // objects from which on the list is searched
const THUMB = 30; // px
const EYE = "M12 5c5 0 8.5 4.4 9.6 7-1.1 2.6-4.6 7-9.6 7s-8.5-4.4-9.6-7C3.5 9.4 7 5 12 5zm0 3a4 4 0 1 0 0 8 4 4 0 0 0 0-8z";
const LOCK = "M7 10V7a5 5 0 0 1 10 0v3h2v11H5V10zm2 0h6V7a3 3 0 0 0-6 0z";
const SHARED = [["mass", "g"], ["friction", ""], ["elasticity", ""]]; // keys that several objects are given at once

// `hidden` and `locked` are of the page alone: the file does not have them
export function makeObjects(editor) {
  const hidden = (editor.hidden = new Set()), locked = (editor.locked = new Set()), chosen = (editor.chosen = new Set());
  let words = "";
  const scene = () => editor.state?.scene;
  const normal = (text) => text.normalize("NFKD").toLowerCase();

  function thumbnail(name) {
    const canvas = element("canvas.thumb", { width: 2 * THUMB, height: 2 * THUMB, "aria-hidden": "true" });
    const draw = () => {
      const { run } = editor.player, k = run?.index.get(name), photo = editor.stage.photo();
      if (k === undefined || !photo) return;
      const pose = run.motion.pose(run.motion.bodies[k], run.motion.locate(0)), body = run.motion.bodies[k], ink = canvas.getContext("2d");
      const far = body.radius ?? Math.max(...body.rings.flat().map(([x, y]) => Math.hypot(x, y))), scale = THUMB / (1.15 * far);
      ink.setTransform(scale, 0, 0, scale, THUMB - scale * pose.x, THUMB - scale * pose.y);
      ink.drawImage(photo, -0.5, -0.5, ...editor.stage.size());
      ink.lineWidth = 3 / scale;
      ink.strokeStyle = OBJECTS[k % OBJECTS.length];
      ink.stroke(editor.stage.pathOf(run, k, pose));
    };
    draw();
    if (!editor.stage.photo()) editor.stage.whenPhoto(draw);
    return canvas;
  }

  function toggle(set, name, words_, path, changed) {
    const made = element("button.mark", { type: "button", "aria-pressed": set.has(name), "aria-label": `${words_} ${name}`, title: words_ }, icon(path));
    made.addEventListener("click", () => {
      if (set.has(name)) set.delete(name); else set.add(name);
      made.setAttribute("aria-pressed", set.has(name));
      changed?.();
      editor.redraw();
    });
    return made;
  }

  function several(redraw) {
    const names = [...chosen].filter((name) => scene().objects[name]);
    if (names.length < 2) return null;
    const ops = (key, value) => names.flatMap((name) => setting(editor, ["objects", name, key], value));
    const rows = SHARED.map(([key, unit]) => {
      const values = new Set(names.map((name) => scene().objects[name][key] ?? editor.state.derived?.objects?.[name]?.[key]));
      const input = element("input", { type: "text", inputmode: "decimal", "aria-label": `${key} of ${names.length} objects`, placeholder: values.size > 1 ? "differs" : String([...values][0] ?? "") });
      input.addEventListener("change", () => {
        const value = Number(input.value.replace(",", "."));
        if (input.value.trim() === "" || !Number.isFinite(value)) { input.setAttribute("aria-invalid", "true"); return; }
        editor.edit(ops(key, value), `${key} of ${names.length} objects: ${value}${unit && ` ${unit}`}`).catch(() => {});
      });
      return element("div.row", {}, element("span.name", {}, key), element("div.of", {}, input, unit && element("span.unit", {}, unit)));
    });
    const pinned = names.every((name) => scene().objects[name].motion === "static");
    return element("section.several", { "aria-label": `${names.length} objects` },
      element("h3", {}, `${names.length} objects`), ...rows,
      element("div.deeds", {},
        button(pinned ? "Unpin" : "Pin", () => editor.edit(ops("motion", pinned ? "dynamic" : "static"), `${names.length} objects ${pinned ? "unpinned" : "pinned"}`).catch(() => {})),
        button("Delete", () => { chosen.clear(); editor.edit(names.map((name) => ({ remove: ["objects", name] })), `${names.length} objects deleted`).catch(() => {}); }, { class: "act bad" }),
        button("Choose none", () => { chosen.clear(); redraw(); })));
  }

  return function list(redraw) {
    const all = Object.entries(scene().objects || {}), rows = element("ul.list.objects", {});
    const item = ([name, object]) => {
      const open = element("button.entry", { type: "button", "aria-pressed": chosen.has(name), title: "Ctrl or Shift click chooses several",
        on: {
          click: (event) => {
            if (!(event.ctrlKey || event.metaKey || event.shiftKey)) { editor.choose({ kind: "object", name }); return; }
            if (chosen.has(name)) chosen.delete(name); else chosen.add(name);
            redraw();
          },
          pointerenter: () => editor.stage.hover({ kind: "object", name }), pointerleave: () => editor.stage.hover(null),
          focus: () => editor.stage.hover({ kind: "object", name }), blur: () => editor.stage.hover(null),
        } }, thumbnail(name), isolated(name), element("small", {}, object.label || ""));
      const also = element("input", { type: "checkbox", "aria-label": `Choose ${name} with others`, title: "Choose several", ...(chosen.has(name) ? { checked: true } : {}) });
      also.addEventListener("change", () => { if (also.checked) chosen.add(name); else chosen.delete(name); redraw(); });
      return element("li", { "data-name": name }, also, open, toggle(hidden, name, "Hide", EYE, () => editor.stage.repaint()), toggle(locked, name, "Lock", LOCK));
    };
    rows.append(...all.map(item));
    const sift = () => { for (const row of rows.children) row.hidden = !normal(`${row.dataset.name} ${scene().objects[row.dataset.name]?.label ?? ""}`).includes(normal(words)); };
    const search = element("input.search", { type: "search", "aria-label": "Search objects", placeholder: "Search objects", value: words, autocomplete: "off" });
    search.addEventListener("input", () => { words = search.value; sift(); });
    sift();
    return [element("h3", {}, "Objects"), ...(all.length >= MANY ? [search] : []), several(redraw), rows].filter(Boolean);
  };
}
