// Move: pick an object up and put it elsewhere, turn it by its ring; pin it, delete it, throw it again.

import { part } from "./elements.js";
import { INKS } from "./stage.js";
import { named, pathOf } from "./app.js";
import { makeDragging, makeRepeated, pixel, point2, rounded, setting } from "./dragging.js";

const RING = 26,
  KNOB = 8;

export function start(editor) {
  const dragging = makeDragging(editor),
    repeated = makeRepeated(editor);
  let shown = null;
  const stage = () => editor.stage,
    scene = () => editor.state?.scene,
    object = (name) => scene()?.objects?.[name];
  const begun = (name) => stage().poseOf(name, 0);
  const reach = (name) => editor.state?.derived?.objects?.[name]?.reach || 20;

  // the objects that joints hold to it, itself first; what is pinned holds like the world
  function held(name) {
    const found = [name];
    for (const one of found)
      for (const { objects } of Object.values(scene().joints || {}))
        if (objects.includes(one)) for (const other of objects) if (!found.includes(other) && object(other)?.motion !== "static") found.push(other);
    return found;
  }
  // ops that move an object by (dx, dy) px and turn it by some degrees about its centre of mass, with what is held to it
  function put(name, dx, dy, turn = 0, alone = false) {
    const { centre } = editor.state.derived.objects[name],
      members = alone ? [name] : held(name),
      by = pixel(editor),
      ops = [];
    // a coordinate that stays is written as it was: what rests on a floor goes on resting there
    const to = centre.map((v, k) => ([dx, dy][k] ? rounded(v + [dx, dy][k], by) : rounded(v, 0.001)));
    const a = (turn * Math.PI) / 180,
      c = Math.cos(a),
      s = Math.sin(a);
    const moved = ([x, y]) => point2([c * (x - centre[0]) - s * (y - centre[1]) + to[0], s * (x - centre[0]) + c * (y - centre[1]) + to[1]], 0.01);
    for (const member of members) ops.push(...placed(member, member === name ? to : moved(editor.state.derived.objects[member].centre), turn, moved));
    (scene().forces || []).forEach((force, k) => {
      if (members.includes(force.object) && force.at) ops.push({ set: ["forces", k, "at"], value: moved(force.at) });
    });
    for (const [joint, item] of Object.entries(scene().joints || {})) {
      const mine = item.objects.map((one) => members.includes(one)),
        kind = ["pivot", "weld", "motor"].find((key) => item[key]);
      const line = ["spring", "rope", "pulley"].find((key) => item[key]);
      if (line && mine.some(Boolean)) {
        const last = item[line].length - 1,
          ends = { 0: mine[0], [last]: mine[1] };
        ops.push({ set: ["joints", joint, line], value: item[line].map((p, k) => (ends[k] ? moved(p) : p)) });
      }
      else if (kind && mine.length === 2 && mine.every(Boolean)) ops.push({ set: ["joints", joint, kind], value: moved(item[kind]) });
    }
    shown = { name, text: turn ? `${rounded(turn, 0.5)}°` : `${to.map((v) => rounded(v, 0.01)).join(", ")} px`, also: members.length - 1 };
    return ops;
  }
  // where one object is written: its shape, or its place where the photo shows it
  function placed(name, to, turn, moved) {
    const item = object(name),
      { masked } = editor.state.derived.objects[name],
      base = ["objects", name],
      { shape } = item,
      ops = [];
    if (masked || item.place || !shape || typeof shape === "string") {
      const angle = rounded((item.place?.[2] || 0) + turn, 0.5) % 360;
      ops.push({ set: [...base, "place"], value: angle ? [...to, angle] : to });
    } else if (shape.circle) ops.push({ set: [...base, "shape", "circle", "center"], value: to });
    else if (shape.box) {
      ops.push({ set: [...base, "shape", "box", "center"], value: to });
      if (turn) ops.push({ set: [...base, "shape", "box", "angle"], value: rounded((shape.box.angle || 0) + turn, 0.5) % 360 });
    } else if (shape.polygon) ops.push({ set: [...base, "shape", "polygon"], value: shape.polygon.map(moved) });
    else if (shape.polygons) {
      const pieces = shape.polygons.map(({ outline, holes }) => ({
        outline: outline.map(moved),
        ...(holes?.length ? { holes: holes.map((ring) => ring.map(moved)) } : {}),
      }));
      ops.push({ set: [...base, "shape", "polygons"], value: pieces });
    }
    if (item.motion?.path) {
      const path = item.motion.path.map(([t, x, y, ...rest]) => [t, ...moved([x, y]), ...rest]);
      ops.push({ set: [...base, "motion", "path"], value: path });
    }
    return ops;
  }

  const level = (way) => (Math.abs(way) < 5 * stage().unit ? 0 : way); // along, or straight up
  function beginMove(name, point) {
    dragging.begin(
      {
        first() {
          editor.player.rewind();
        },
        to: (to, event) => put(name, level(to[0] - point[0]), level(to[1] - point[1]), 0, event.altKey),
        describe: () => `${name} put at ${shown.text}${shown.also ? `, with ${shown.also} held to it` : ""}`,
        done: () => {
          shown = null;
        },
      },
      point,
    );
  }
  const knob = (name, turned = 0) => {
    const pose = begun(name),
      r = reach(name) + RING * stage().unit,
      a = -Math.PI / 2 + turned;
    return [pose.x + r * Math.cos(a), pose.y + r * Math.sin(a)];
  };
  function beginTurn(name, point) {
    const pose = begun(name),
      first = Math.atan2(point[1] - pose.y, point[0] - pose.x);
    dragging.begin(
      {
        turned: 0,
        to(to) {
          const now = Math.atan2(to[1] - pose.y, to[0] - pose.x) - first;
          const turn = rounded((Math.atan2(Math.sin(now), Math.cos(now)) * 180) / Math.PI, 1);
          this.turned = (turn * Math.PI) / 180;
          return put(name, 0, 0, turn);
        },
        describe: () => `${name} turned by ${shown.text}`,
        done: () => {
          shown = null;
        },
      },
      point,
    );
  }
  const selected = () =>
    editor.selected?.kind === "object" && object(editor.selected.name) && begun(editor.selected.name) ? editor.selected.name : null;
  const turnable = (name) => {
    const item = object(name);
    return item.motion?.path === undefined;
  };
  const onKnob = (point, finger) => {
    const name = selected();
    return name &&
      turnable(name) &&
      editor.player.time < 1e-6 &&
      Math.hypot(...knob(name).map((v, k) => v - point[k])) < (finger ? 22 : 12) * stage().unit
      ? name
      : null;
  };

  editor.registerTool({
    name: "move",
    label: "Move",
    key: "v",
    icon: "M12 2l4 4h-3v5h5V8l4 4-4 4v-3h-5v5h3l-4 4-4-4h3v-5H6v3l-4-4 4-4v3h5V6H8z",
    cursorAt: (point) => (editor.grips?.at(point) || onKnob(point) ? "grab" : stage().hovered ? "move" : "default"),
    down(point, event, hit) {
      const finger = event.pointerType === "touch",
        turn = onKnob(point, finger);
      if (turn) {
        beginTurn(turn, point);
        return;
      }
      const grip = editor.grips?.at(point, finger);
      if (grip) {
        dragging.begin(grip.drag(point), point);
        return;
      }
      editor.choose(hit);
      if (hit?.kind === "object") beginMove(hit.name, point);
      else if (hit && editor.grips) {
        const whole = editor.grips.whole(hit, point);
        if (whole) dragging.begin(whole, point);
      }
    },
    move(point, event) {
      dragging.move(point, event);
    },
    up() {
      return dragging.up();
    },
    cancel() {
      shown = null;
      return dragging.cancel();
    },
    draw(context, pen) {
      const name = selected();
      editor.grips?.draw(context, pen);
      if (!name || editor.player.time > 1e-6 || editor.player.playing) return;
      if (turnable(name)) {
        const pose = begun(name),
          r = reach(name) + RING * pen.unit,
          path = new Path2D(),
          grip = new Path2D(),
          [x, y] = knob(name, dragging.drag?.turned || 0);
        path.arc(pose.x, pose.y, r, 0, 2 * Math.PI);
        pen.stroke(path, "#fff", 1, 0.35, [2, 5]);
        grip.arc(x, y, KNOB * pen.unit, 0, 2 * Math.PI);
        pen.stroke(grip, "#fff", 2);
        pen.fill(grip, INKS.accent);
      }
      if (dragging.drag && dragging.moved && shown)
        pen.words(shown.text, begun(name).x, begun(name).y - reach(name) - 46 * pen.unit, "#fff", { size: 13 });
    },
    nudge([dx, dy], { shiftKey }) {
      const entry = editor.selected,
        by = pixel(editor) * (shiftKey ? 10 : 1);
      if (!entry) return false;
      return repeated(`${entry.kind} ${entry.name} ${by}`, [dx, dy], ([x, y]) => {
        editor.player.rewind();
        const ops = entry.kind === "object" ? put(entry.name, x * by, y * by) : editor.grips?.shifted(entry, x * by, y * by);
        return ops && { ops, what: `${entry.name} moved`, tag: `move ${entry.kind} ${entry.name}` };
      });
    },
    turn(by) {
      const name = selected();
      if (!name || !turnable(name)) return false;
      return repeated(`turn ${name}`, [by], ([turns]) => ({ ops: put(name, 0, 0, turns * 5), what: `${name} turned`, tag: `turn ${name}` }));
    },
  });

  // ---- what can be done to whatever is chosen
  editor.acts = {
    pinned: (name) => object(name)?.motion === "static",
    pin(name = selected()) {
      if (!name) return;
      const now = object(name).motion === "static";
      editor
        .edit(now && !editor.variant ? [{ unset: ["objects", name, "motion"] }] : setting(editor, ["objects", name, "motion"], now ? "dynamic" : "static"), now ? `${name} unpinned` : `${name} pinned`)
        .then(() => editor.say(now ? `${name} moves again` : `${name} is pinned: it never moves`))
        .catch(() => {});
    },
    erase(entry = editor.selected) {
      if (!entry || entry.kind === "light" || !named(entry)) return;
      const what = entry.kind === "force" ? `push on ${named(entry).object} erased` : `${entry.name} deleted`;
      editor.choose(null);
      editor
        .edit([{ remove: pathOf(entry) }], what)
        .then(() => editor.say(`${what}; Ctrl Z brings it back`))
        .catch(() => {});
      part("over").focus({ preventScroll: true });
    },
  };
}
