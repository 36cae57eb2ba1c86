// The panel of what is chosen: an object, a boundary, a push, a joint or a field; and a list of all where nothing is.

import { button, element, isolated } from "./elements.js";
import { named, pathOf, same } from "./app.js";
import { loadSchema, makeRow } from "./fields.js";
import { FIELDS, HOLDS, makePanels } from "./entries.js";
import { makeObjects } from "./objects.js";

export function start(editor) {
  const body = element("div.sheet", {});
  let rows = [],
    shown = "";
  editor.addPanel({ id: "object", title: "Object", element: body, order: 10 });
  const objects = makeObjects(editor),
    anew = () => {
      shown = "";
      show();
    };
  const scene = () => editor.state?.scene,
    derived = (name) => editor.state?.derived?.objects?.[name];
  const meter = () => editor.state?.derived?.pixels_per_meter;
  const si = (value, unit) => (Number.isFinite(value) ? `${value.toLocaleString("en", { maximumSignificantDigits: 3 })} ${unit}`.replace("-", "−") : "");

  // what a rebuilt panel depends on: which entry, and which keys it has
  const form = (entry) => {
    const item = entry && named(entry);
    if (!item)
      return `list ${JSON.stringify(scene() && [Object.entries(scene().objects || {}).map(([n, o]) => [n, o.label, o.motion]), Object.keys(scene().boundaries || {}), (scene().forces || []).map((f) => Object.keys(f).concat(f.object)), Object.keys(scene().joints || {}), Object.keys(scene().fields || {})])}`;
    const pushes =
      entry.kind === "object" ? (scene().forces || []).map((f, k) => (f.object === entry.name ? `${k}${Object.keys(f)}` : "")).join() : "";
    return `${entry.kind} ${entry.name} ${item.label ?? ""} ${Object.keys(item).filter((key) => [...HOLDS, "impulse", "force", "torque", "wind", "attractor", "segment", "polyline", "mask", "limits"].includes(key) && item[key] != null)} ${JSON.stringify(item.motion)} ${scene().world?.view} ${pushes} ${editor.materials.length} ${Object.keys(scene().objects || {})} ${entry.kind === "object" ? oddities(entry.name) : ""}`;
  };
  function show() {
    const entry = editor.selected && named(editor.selected) ? editor.selected : null,
      now = form(entry);
    if (now === shown) {
      rows.forEach((row) => row.fill());
      return;
    }
    shown = now;
    const focused = document.activeElement?.closest?.("[data-row]")?.dataset.row,
      inside = body.contains(document.activeElement);
    rows = [];
    body.replaceChildren(
      ...(!scene()
        ? [element("p.empty", {}, "The scene file has errors: see To do or YAML.")]
        : entry
          ? panels[entry.kind](entry)
          : list()),
    );
    if (inside && focused) body.querySelector(`[data-row="${CSS.escape(focused)}"] :is(input, select)`)?.focus();
  }
  const row = (path, name, options) => {
    const made = makeRow(editor, path, name, options);
    rows.push(made);
    return made.row;
  };
  const title = (kind, name, about) => [
    button("‹ All objects", () => editor.choose(null), { class: "link all" }),
    element("h2", {}, isolated(name)),
    element("p.about", {}, about || kind),
  ];
  const heading = (text) => element("h3", {}, text);
  const deeds = (...all) => element("div.deeds", {}, ...all);
  const erase = (entry) => button("Delete", () => editor.acts.erase(entry), { class: "act bad", title: "Delete" });

  const renamed = (entry) =>
    row([...pathOf(entry), "(name)"], "name", {
      spec: { type: "string", maxLength: 64 },
      kind: "text",
      required: true,
      get: () => entry.name,
      called: entry.name,
      edits: (value) => [{ rename: pathOf(entry), to: value }],
    });

  const oddities = (name) =>
    (editor.state.problems || [])
      .filter((problem) => problem.object === name)
      .map(({ message, fix, path }) => `${path.split(".").slice(2).join(" ") || path}: ${message}${fix ? `; ${fix}` : ""}`);
  const odd = (name) => (oddities(name).length ? element("ul.warnings", {}, ...oddities(name).map((text) => element("li", {}, text))) : null);

  const panels = makePanels(editor, { row, title, heading, deeds, erase, renamed, odd, si });

  // what can be made without drawing it; its numbers are changed in its panel
  function starters() {
    const [w, h] = editor.stage.size(),
      first = Object.keys(scene().objects || {})[0],
      m = meter() || 100;
    return [
      [
        "Floor",
        "boundary",
        "floor",
        {
          segment: [
            [0, Math.round(0.9 * h)],
            [w, Math.round(0.9 * h)],
          ],
        },
      ],
      first && derived(first) && ["Pin", "joint", "pin", { objects: [first], pivot: derived(first).centre.map((v) => Math.round(v)) }],
      ["Wind", "field", "wind", { wind: [+(2 * m).toPrecision(1), 0], drag: 0.002 }],
      [
        "Attractor",
        "field",
        "attractor",
        { attractor: [Math.round(w / 2), Math.round(h / 2)], strength: +(9.8 * m * (0.3 * w) ** 2).toPrecision(1), soften: 20 },
      ],
    ].filter(Boolean);
  }
  function list() {
    const group = (kind, names, about) =>
      names.length
        ? [
            heading({ object: "Objects", boundary: "Boundaries", force: "Pushes", joint: "Joints", field: "Fields" }[kind]),
            element(
              "ul.list",
              {},
              ...names.map((name) => {
                const entry = { kind, name };
                return element(
                  "li",
                  {},
                  element(
                    "button",
                    {
                      type: "button",
                      "aria-pressed": same(editor.selected, entry),
                      on: {
                        click: () => editor.choose(entry),
                        pointerenter: () => editor.stage.hover(entry),
                        pointerleave: () => editor.stage.hover(null),
                        focus: () => editor.stage.hover(entry),
                        blur: () => editor.stage.hover(null),
                      },
                    },
                    isolated(kind === "force" ? `on ${scene().forces[name].object}` : name),
                    element("small", {}, about(name) || ""),
                  ),
                );
              }),
            ),
          ]
        : [];
    const all = scene();
    return [
      element("p.about", {}, "Choose an object on the photo or here. Drag from an object to push it."),
      ...(Object.keys(all.objects || {}).length ? objects(anew) : []),
      ...group("boundary", Object.keys(all.boundaries || {}), (n) =>
        all.boundaries[n].segment ? "one wall" : all.boundaries[n].polyline ? "chain" : "mask",
      ),
      ...group(
        "force",
        (all.forces || []).map((_, k) => k),
        (k) => ["impulse", "force", "torque"].find((key) => all.forces[k][key] != null),
      ),
      ...group("joint", Object.keys(all.joints || {}), (n) => HOLDS.find((k) => all.joints[n][k])),
      ...group("field", Object.keys(all.fields || {}), (n) => FIELDS.find((key) => all.fields[n][key])),
      heading("Add"),
      deeds(
        ...starters().map(([words, kind, wanted, value]) =>
          button(words, () => {
            const sections = { boundary: "boundaries", joint: "joints", field: "fields" },
              name = editor.freeName(sections[kind], wanted);
            editor
              .edit([{ add: [sections[kind], name], value }], `${name} made`)
              .then(() => editor.choose({ kind, name }))
              .catch(() => {});
          }),
        ),
      ),
    ];
  }
  editor.on("select", (entry) => {
    if (entry && editor.panel === "world") editor.showPanel("object");
  });
  loadSchema().then(() => {
    for (const event of ["state", "select"]) editor.on(event, show);
    if (editor.state) show();
  });
}
