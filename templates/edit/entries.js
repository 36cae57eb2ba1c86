// What the panel shows of an object, by its kind: rows for its keys, and what can be done to it.

import { button, element } from "./elements.js";
import { named, pathOf } from "./app.js";
import { written } from "./dragging.js";
import { specOf } from "./fields.js";
import { makeMaterials } from "./materials.js";

export const HOLDS = ["pivot", "spring", "weld", "motor", "slider", "rope", "pulley", "gear", "finger"];
export const FIELDS = ["wind", "air", "water", "magnet", "attractor"];
const LIMITS = [-45, 45]; // degrees, of a pin that gets limits
const ENDS = { finger: [], spring: ["from", "to"], slider: ["from", "to"], rope: ["from", "to"], pulley: ["from", "over", "and", "to"], gear: [] };

// `kit` makes rows, titles and deeds
export function makePanels(editor, { row, title, heading, deeds, erase, renamed, odd, si }) {
  const scene = () => editor.state?.scene,
    derived = (name) => editor.state?.derived?.objects?.[name],
    meter = () => editor.state?.derived?.pixels_per_meter;
  const { madeOf, current } = makeMaterials(editor);
  const roundMass = (name, by) => +((derived(name)?.mass || 1) * by * (meter() || 100)).toPrecision(1);

  return {
    object(entry) {
      const { name } = entry,
        path = pathOf(entry),
        item = named(entry),
        still = typeof item.motion === "string" && item.motion === "static";
      const top = scene().world?.view === "top",
        pushes = (scene().forces || []).map((f, k) => ({ ...f, k })).filter((f) => f.object === name);
      return [
        ...title("object", name, item.label || "object"),
        deeds(
          button(still ? "Unpin" : "Pin", () => editor.acts.pin(name), { "aria-pressed": still, title: "Pinned: it never moves (x)" }),
          button("Play again", () => editor.player.again(), { title: "Play from the beginning (r)" }),
          erase(entry),
        ),
        odd(name),
        heading("What it is"),
        renamed(entry),
        row([...path, "label"], "label"),
        editor.materials.length
          ? row([...path, "(material)"], "material", {
              spec: {},
              kind: "choice",
              choices: editor.materials.map((m) => m.name),
              none: "as the numbers say",
              get: () => current(name),
              required: true,
              called: `${name} material`,
              edits: (value) => madeOf(name, value),
            })
          : null,
        row([...path, "mass"], "mass", {
          fallback: () => null,
          placeholder: () => +(derived(name)?.mass ?? 0).toPrecision(4),
          says: () =>
            derived(name)
              ? `${si(derived(name).mass / 1000, "kg")}${item.mass == null ? (written(editor, [...path, "density"]) ? ", by its density" : ", for density 1") : ""}`
              : "",
        }),
        row([...path, "density"], "density", { fallback: () => null }),
        row([...path, "solid"], "solid", { none: derived(name)?.ball ? "sphere, as perceived" : derived(name)?.radius ? "disc, by its shape" : "plate, by its shape" }),
        heading("Surface"),
        row([...path, "friction"], "friction"),
        row([...path, "elasticity"], "elasticity"),
        row([...path, "rolling"], "rolling"),
        heading("Motion"),
        row(
          [...path, "motion"],
          "motion",
          item.motion?.path
            ? {
                kind: "choice",
                choices: ["dynamic", "static", { value: "path", name: "along a path" }],
                get: () => "path",
                called: `${name} motion`,
                edits: (v) => (v === "path" ? [] : [{ set: [...path, "motion"], value: v }]),
              }
            : { kind: "choice", choices: ["dynamic", "static"] },
        ),
        ...(still || item.motion?.path
          ? []
          : [
              row([...path, "velocity"], "velocity", { says: (v) => (v && meter() ? si(Math.hypot(...v) / meter(), "m/s") : "") }),
              row([...path, "spin"], "spin", { step: 45, says: (v) => (v ? si((v * Math.PI) / 180, "rad/s") : "") }),
              top && derived(name)?.ball && typeof (item.roll ?? "natural") === "string"
                ? row([...path, "roll"], "roll", { kind: "choice", choices: ["natural", "none"] })
                : null,
            ]),
        row([...path, "layer"], "layer"),
        ...(still
          ? []
          : [
              heading("Pushes"),
              pushes.length
                ? element(
                    "ul.list",
                    {},
                    ...pushes.map((f) =>
                      element(
                        "li",
                        {},
                        element(
                          "button",
                          { type: "button", on: { click: () => editor.choose({ kind: "force", name: f.k }) } },
                          element("span", {}, f.impulse ? "impulse" : f.force ? "force" : "torque"),
                          element(
                            "small",
                            {},
                            f.impulse || f.force ? `(${(f.impulse || f.force).map((v) => v.toLocaleString("en", { maximumSignificantDigits: 3 })).join(", ")})`.replaceAll("-", "−") : String(f.torque),
                          ),
                        ),
                      ),
                    ),
                  )
                : element("p.empty", {}, "None: drag from the object with the tool Push."),
              deeds(
                ...[
                  ["impulse", { impulse: [roundMass(name, 1), 0] }],
                  ["force", { force: [roundMass(name, 5), 0], duration: 0.2 }],
                  ["torque", { torque: roundMass(name, 50), duration: 0.2 }],
                ].map(([kind, value]) =>
                  button(`Add ${kind}`, () =>
                    editor
                      .edit([{ add: ["forces"], value: { object: name, ...value } }], `${kind} on ${name}`)
                      .then(() => editor.choose({ kind: "force", name: scene().forces.length - 1 }))
                      .catch(() => {}),
                  ),
                ),
              ),
            ]),
      ].filter(Boolean);
    },
    boundary(entry) {
      const path = pathOf(entry),
        item = named(entry),
        points = item.segment || item.polyline;
      return [
        ...title(
          "boundary",
          entry.name,
          points ? `boundary of ${points.length} points; drag them with the tool Move` : "boundary along the outlines of a mask",
        ),
        deeds(erase(entry)),
        heading("What it is"),
        renamed(entry),
        ...(item.segment
          ? [0, 1].map((k) =>
              row([...path, "segment", k], k ? "to" : "from", {
                spec: { prefixItems: [{}, {}], "x-unit": "px" },
                required: true,
                called: `${entry.name} end`,
                edits: (value) => [{ set: [...path, "segment"], value: item.segment.map((p, n) => (n === k ? value : named(entry).segment[n])) }],
              }),
            )
          : []),
        heading("Surface"),
        row([...path, "friction"], "friction"),
        row([...path, "elasticity"], "elasticity"),
      ];
    },
    force(entry) {
      const path = pathOf(entry),
        item = named(entry),
        kind = ["impulse", "force", "torque"].find((k) => item[k] != null);
      const unit = (v) =>
        kind === "torque" ? si(v / 1000 / meter() ** 2, "N·m") : si(Math.hypot(...v) / 1000 / meter(), kind === "impulse" ? "N·s" : "N");
      return [
        ...title("push", `${kind} on ${item.object}`, "push"),
        deeds(
          button("Its object", () => editor.select(item.object)),
          erase(entry),
        ),
        heading("What it gives"),
        row([...path, "object"], "object", { kind: "choice", choices: Object.keys(scene().objects), required: true }),
        row([...path, kind], kind, { required: true, says: (v) => (v != null && meter() ? unit(v) : "") }),
        kind === "torque" ? null : row([...path, "at"], "acts at", { says: (v) => (v ? "" : "the centre of mass") }),
        heading("When"),
        row([...path, "start"], "starts", { step: 0.05 }),
        kind === "impulse" ? null : row([...path, "duration"], "lasts", { step: 0.05, says: (v) => (v == null ? "to the end" : "") }),
      ].filter(Boolean);
    },
    joint(entry) {
      const path = pathOf(entry),
        item = named(entry),
        kind = HOLDS.find((k) => item[k]),
        names = Object.keys(scene().objects);
      const at =
        ENDS[kind]
          ? ENDS[kind].map((label, k) =>
              row([...path, kind, k], label, {
                spec: { prefixItems: [{}, {}], "x-unit": "px" },
                required: true,
                edits: (value) => [{ set: [...path, kind], value: named(entry)[kind].map((p, n) => (n === k ? value : p)) }],
              }),
            )
          : [row([...path, kind], "at", { required: true })];
      const holds = (k) =>
        row([...path, "objects", k], k ? "to" : "holds", {
          spec: {},
          kind: "choice",
          choices: names,
          none: k ? "the world" : undefined,
          required: !k,
          get: () => named(entry).objects[k] ?? null,
          called: `${entry.name} holds`,
          edits: (value) => [
            { set: [...path, "objects"], value: k ? [named(entry).objects[0], value].filter(Boolean) : [value, ...named(entry).objects.slice(1)] },
          ],
        });
      // the least and the largest angle; a limit that is set alone has its mirror image opposite
      const limit = (k) =>
        row([...path, "limits", k], k ? "upper limit" : "lower limit", {
          whole: [...path, "limits"],
          spec: specOf([...path, "limits"]).prefixItems?.[k] || {},
          unit: "°",
          step: 5,
          called: `${entry.name} limits`,
          says: (v) => (v == null ? "freely" : ""),
          edits: (value) => {
            if (value === null) return [{ unset: [...path, "limits"] }];
            const limits = named(entry).limits ? [...named(entry).limits] : [-value, -value];
            limits[k] = value;
            return [{ set: [...path, "limits"], value: limits }];
          },
        });
      const turns = kind === "pivot" || kind === "motor";
      return [
        ...title(
          "joint",
          entry.name,
          {
            pivot: "pin: both sides turn freely about it",
            spring: "spring with a damper",
            weld: "weld: neither moves against the other",
            motor: "motor: it turns the first",
            slider: "slider: the first runs along a rail",
            rope: "rope: no farther apart than its length",
            pulley: "pulley: a rope over two points",
            gear: "gear: the two turn at a ratio",
            finger: "finger: it pulls along its way, then lets go",
          }[kind],
        ),
        deeds(
          turns && !item.limits
            ? button("Limit its angle", () => editor.edit([{ set: [...path, "limits"], value: LIMITS }], `${entry.name} limited`).catch(() => {}), {
                title: "Handles around the pin set how far the first object turns",
              })
            : null,
          erase(entry),
        ),
        heading("What it holds"),
        renamed(entry),
        holds(0),
        holds(1),
        ...at,
        heading("How"),
        ...(kind === "finger" ? [row([...path, "stiffness"], "stiffness", { required: true }), row([...path, "damping"], "damping")] : []),
        ...(kind === "spring"
          ? [
              row([...path, "stiffness"], "stiffness", { required: true }),
              row([...path, "damping"], "damping"),
              row([...path, "length"], "length", { says: (v) => (v == null ? "as at the start" : "") }),
            ]
          : []),
        ...(kind === "motor"
          ? [
              row([...path, "speed"], "speed", { required: true, step: 45 }),
              row([...path, "limit"], "limit", { says: (v) => (v == null ? "as much as it takes" : "") }),
            ]
          : []),
        ...(kind === "rope" || kind === "pulley" ? [row([...path, "length"], "length", { says: (v) => (v == null ? "as at the start" : "") })] : []),
        ...(kind === "gear" ? [row([...path, "gear"], "ratio", { required: true })] : []),
        ...(kind === "slider"
          ? [
              row([...path, "drive"], "drive", { says: (v) => (v == null ? "slides freely" : "") }),
              row([...path, "force"], "force", { says: (v) => (v == null ? "as much as it takes" : "") }),
            ]
          : []),
        ...(turns ? [limit(0), limit(1)] : []),
        ...(kind === "pivot" ? [row([...path, "friction"], "friction")] : []),
        row([...path, "breaks"], "breaks at", { says: (v) => (v == null ? "never" : "") }),
        row([...path, "collide"], "bump", { spec: { type: "boolean", description: "Whether the two objects also collide with each other." } }),
      ];
    },
    field(entry) {
      const path = pathOf(entry),
        item = named(entry);
      return [
        ...title(
          "field",
          entry.name,
          {
            wind: "wind",
            air: "air that rests",
            water: "water: left, top, width, height",
            magnet: "magnets",
            attractor: "point that attracts; negative strength repels",
          }[FIELDS.find((key) => item[key])],
        ),
        deeds(erase(entry)),
        heading("What it does"),
        renamed(entry),
        ...(item.wind
          ? [
              row([...path, "wind"], "wind", { required: true, says: (v) => (v && meter() ? si(Math.hypot(...v) / meter(), "m/s") : "") }),
              row([...path, "drag"], "drag", { required: true }),
            ]
          : item.magnet
          ? [row([...path, "pull"], "pull", { required: true }), row([...path, "soften"], "soften")]
          : item.air || item.water
          ? [
              ...(item.water ? [0, 1, 2, 3].map((k) => row([...path, "water", k], ["left", "top", "width", "height"][k], { required: true })) : []),
              ...(item.water ? [row([...path, "density"], "density", { required: true })] : []),
              row([...path, "drag"], "drag"),
              row([...path, "linear"], "linear"),
            ]
          : [
              row([...path, "attractor"], "at", { required: true }),
              row([...path, "strength"], "strength", { required: true }),
              row([...path, "soften"], "soften"),
            ]),
        element("p.about", {}, item.objects || item.magnet ? `on ${(item.objects || item.magnet).join(", ")}` : "on everything that moves freely"),
      ];
    },
  };
}
