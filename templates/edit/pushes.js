// What the file pushes: its arrows and turns, how long they are drawn, and in what words.
// Every arrow is as long as the velocity that it gives: an impulse over the mass, a force over the mass for its time.

import { roundAbove } from "./dragging.js";

export const KINDS = [
  { kind: "velocity", name: "Velocity", held: "", unit: "px/s" },
  { kind: "impulse", name: "Impulse", held: "Shift", unit: "g·px/s" },
  { kind: "force", name: "Force", held: "Alt", unit: "g·px/s²" },
];
export const LASTS = 0.2; // s, of a force that is drawn
export const TURNS = 4; // degrees a second for each degree that the ring is turned

export function makePushes(editor) {
  let per = 0;
  const scene = () => editor.state?.scene;
  const object = (name) => scene()?.objects?.[name];
  const meter = () => editor.state?.derived?.pixels_per_meter || 100;
  const mass = (name) => editor.state?.derived?.objects?.[name]?.mass || 1;
  const moment = (name) => editor.state?.derived?.objects?.[name]?.moment || 1;
  const pinned = (name) => {
    const how = object(name)?.motion;
    return how && how !== "dynamic";
  };
  const begun = (name) => editor.stage.poseOf(name, 0);
  const index = (name, kind) => (scene().forces || []).findIndex((f) => f.object === name && f[kind] !== undefined);
  const lasts = (force) => Math.min(force.duration ?? LASTS, 10);

  // px of the photo for each px/s: it stays while arrows are dragged
  function scaled() {
    const large = Math.max(...editor.stage.size()),
      typical = Math.sqrt(9.8 * meter() * large);
    const speeds = Object.values(scene()?.objects || {})
      .map((o) => Math.hypot(...(o.velocity || [0, 0])))
      .filter(Boolean);
    const usual = (0.3 * large) / typical;
    const wanted = speeds.length ? (0.2 * large) / Math.max(...speeds) : usual;
    per = roundBelow(clamp(wanted, usual / 8, usual * 2));
  }
  editor.on("state", ({ before }) => {
    if (!before || !per) scaled();
  });
  editor.on("view", () => {
    if (editor.state && !per) scaled();
  });

  // what a screen's pixel is worth, rounded: the step of what is written
  const step = (worth) => roundAbove(Math.max((worth * 2 * editor.stage.unit) / per, 1e-12));

  // every arrow that the file has: where it begins, and how long it is in px of the photo
  function arrows() {
    const all = [];
    for (const [name, item] of Object.entries(scene()?.objects || {})) {
      const pose = begun(name),
        [vx, vy] = item.velocity || [0, 0];
      if (pose && !pinned(name) && (vx || vy)) all.push({ kind: "velocity", name, x: pose.x, y: pose.y, dx: vx * per, dy: vy * per });
    }
    (scene()?.forces || []).forEach((force, k) => {
      const pose = begun(force.object),
        kind = force.impulse ? "impulse" : force.force ? "force" : null;
      if (!pose || !kind) return;
      const [x, y] = force.at || [pose.x, pose.y],
        worth = kind === "impulse" ? per / mass(force.object) : (per * lasts(force)) / mass(force.object);
      all.push({ kind, name: force.object, index: k, x, y, dx: force[kind][0] * worth, dy: force[kind][1] * worth });
    });
    return all;
  }
  // turns that the file has: spins, and what torques give, as the angle of the ring
  function turns() {
    const all = Object.entries(scene()?.objects || {})
      .filter(([name, item]) => item.spin && !pinned(name) && begun(name))
      .map(([name, item]) => ({ kind: "spin", name, angle: item.spin / TURNS }));
    (scene()?.forces || []).forEach((force, index) => {
      if (force.torque && begun(force.object))
        all.push({
          kind: "torque",
          name: force.object,
          index,
          angle: ((force.torque * lasts(force)) / moment(force.object) / TURNS) * (180 / Math.PI),
        });
    });
    return all;
  }
  const long = (arrow) => Math.hypot(arrow.dx, arrow.dy) > 4 * editor.stage.unit;

  function words(kind, name, [x, y], lasting) {
    const size = Math.hypot(x, y),
      m = meter();
    const [px, si, unit] = { velocity: [size, size / m, "m/s"], impulse: [size, size / 1000 / m, "N·s"], force: [size, size / 1000 / m, "N"] }[kind];
    return `${short(px)} ${KINDS.find((k) => k.kind === kind).unit} · ${short(si)} ${unit}${kind === "force" ? ` for ${short(lasting)} s` : ""}`;
  }
  const short = (value) => {
    if (!value) return "0";
    const power = Math.floor(Math.log10(Math.abs(value)));
    if (power >= 6 || power < -3)
      return `${+(value / 10 ** power).toPrecision(3)}·10${[...String(power)].map((d) => (d === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[d])).join("")}`;
    return value.toLocaleString("en", { maximumSignificantDigits: 3 }).replace("-", "−");
  };
  const reach = (name) => editor.state?.derived?.objects?.[name]?.reach || 20;
  return {
    get per() {
      return per;
    },
    ...{ object, meter, mass, moment, reach, pinned, begun, index, lasts, step, arrows, turns, long, words, short },
  };
}
