// Push: drag from an object for its velocity; an impulse, a force or a turn with a key held or its button chosen.

import { element, part } from "./elements.js";
import { INKS } from "./stage.js";
import { makeDragging, makeRepeated, rounded, setting } from "./dragging.js";
import { KINDS, LASTS, TURNS, makePushes } from "./pushes.js";

const RING = 26,
  KNOB = 8,
  TIP = 11;

export function start(editor) {
  const dragging = makeDragging(editor),
    repeated = makeRepeated(editor);
  const pushes = makePushes(editor),
    { object, meter, mass, moment, reach, pinned, begun, index, lasts, step, arrows, turns, long, words, short } = pushes;
  let chosen = "velocity",
    shown = null;

  const stage = () => editor.stage,
    scene = () => editor.state?.scene;
  const kindOf = (event) => (event.shiftKey ? "impulse" : event.altKey ? "force" : chosen);

  // a vector of px on the photo -> ops that make it what is asked for
  function pushed(kind, name, at, [dx, dy], known = index(name, kind)) {
    const near = 6 * stage().unit;
    if (Math.abs(dx) < near) dx = 0;
    if (Math.abs(dy) < near) dy = 0;
    const force = known >= 0 ? scene().forces[known] : {},
      lasting = lasts(force);
    const worth = kind === "velocity" ? 1 : kind === "impulse" ? mass(name) : mass(name) / lasting,
      by = step(worth);
    const value = [rounded((dx * worth) / pushes.per, by), rounded((dy * worth) / pushes.per, by)];
    shown = {
      kind,
      name,
      x: at[0],
      y: at[1],
      dx: (value[0] * pushes.per) / worth,
      dy: (value[1] * pushes.per) / worth,
      text: words(kind, name, value, lasting),
      ring: null,
    };
    if (kind === "velocity") return setting(editor, ["objects", name, "velocity"], value);
    if (known >= 0) return !dx && !dy ? [{ remove: ["forces", known] }] : [{ set: ["forces", known, kind], value }];
    if (!dx && !dy) return null;
    const pose = begun(name),
      off = Math.hypot(at[0] - pose.x, at[1] - pose.y) > 0.15 * reach(name);
    const made = {
      object: name,
      [kind]: value,
      ...(off ? { at: at.map((v) => rounded(v, 0.5)) } : {}),
      ...(kind === "force" ? { duration: LASTS } : {}),
    };
    return [{ add: ["forces"], value: made }];
  }

  // the first push leaves t = 0; where it was pressed, seen from the body, stays
  function beginPush(name, point, arrow) {
    const pose = begun(name),
      now = stage().poseOf(name);
    const c = Math.cos(-now.a),
      s = Math.sin(-now.a),
      px = point[0] - now.x,
      py = point[1] - now.y;
    const at = arrow ? [arrow.x, arrow.y] : [pose.x + c * px - s * py, pose.y + s * px + c * py];
    const tip = arrow ? [arrow.x + arrow.dx - point[0], arrow.y + arrow.dy - point[1]] : null;
    dragging.begin(
      {
        first() {
          editor.player.rewind();
        },
        to(to, event) {
          const kind = arrow ? arrow.kind : kindOf(event),
            anchor = kind === "velocity" ? [pose.x, pose.y] : at;
          const vector = tip ? [to[0] + tip[0] - anchor[0], to[1] + tip[1] - anchor[1]] : [to[0] - point[0], to[1] - point[1]];
          return pushed(kind, name, anchor, vector, arrow?.index);
        },
        describe: () => `${KINDS.find((k) => k.kind === shown.kind).name} of ${name}: ${shown.text}`,
        done: () => {
          shown = null;
          editor.player.once();
        },
      },
      point,
    );
  }

  // ---- turning: a ring around the object
  const radius = (name) => reach(name) + RING * stage().unit;
  const knob = (name) => {
    const pose = begun(name),
      spin = object(name)?.spin || 0,
      a = -Math.PI / 2 + ((spin / TURNS) * Math.PI) / 180,
      r = radius(name);
    return [pose.x + r * Math.cos(a), pose.y + r * Math.sin(a)];
  };
  function beginTurn(name, point) {
    const pose = begun(name),
      first = Math.atan2(point[1] - pose.y, point[0] - pose.x);
    let last = first,
      turned = (object(name).spin || 0) / TURNS;
    const known = index(name, "torque");
    let torque = false;
    dragging.begin(
      {
        first() {
          editor.player.rewind();
        },
        to(to, event) {
          const now = Math.atan2(to[1] - pose.y, to[0] - pose.x);
          turned += (Math.atan2(Math.sin(now - last), Math.cos(now - last)) * 180) / Math.PI;
          last = now;
          torque = event.altKey || event.shiftKey || chosen !== "velocity";
          const spin = rounded(turned * TURNS, 10);
          if (!torque) {
            shown = {
              kind: "spin",
              name,
              x: pose.x,
              y: pose.y,
              dx: 0,
              dy: 0,
              ring: turned,
              text: `${short(spin)} °/s · ${short((spin * Math.PI) / 180)} rad/s`,
            };
            return setting(editor, ["objects", name, "spin"], spin);
          }
          const lasting = known >= 0 ? lasts(scene().forces[known]) : LASTS,
            exact = (moment(name) * spin * Math.PI) / 180 / lasting;
          const value = exact ? +exact.toPrecision(2) : 0;
          shown = {
            kind: "torque",
            name,
            x: pose.x,
            y: pose.y,
            dx: 0,
            dy: 0,
            ring: turned,
            text: `${short(value)} g·px²/s² · ${short(value / 1000 / meter() ** 2)} N·m for ${short(lasting)} s`,
          };
          if (known >= 0) return value ? [{ set: ["forces", known, "torque"], value }] : [{ remove: ["forces", known] }];
          return value ? [{ add: ["forces"], value: { object: name, torque: value, duration: LASTS } }] : null;
        },
        describe: () => `${torque ? "Torque" : "Spin"} of ${name}: ${shown.text}`,
        done: () => {
          shown = null;
          editor.player.once();
        },
      },
      point,
    );
  }

  function tipAt(point, finger) {
    const near = (finger ? 2 : 1) * TIP * stage().unit,
      first = editor.selected?.name;
    return arrows()
      .filter((a) => long(a) && Math.hypot(a.x + a.dx - point[0], a.y + a.dy - point[1]) < near)
      .sort((a, b) => (b.name === first) - (a.name === first))[0];
  }
  const selected = () =>
    editor.selected?.kind === "object" && object(editor.selected.name) && !pinned(editor.selected.name) && begun(editor.selected.name)
      ? editor.selected.name
      : null;
  const onKnob = (point, finger) => {
    const name = selected();
    return name && editor.player.time < 1e-6 && Math.hypot(...knob(name).map((v, k) => v - point[k])) < (finger ? 22 : 12) * stage().unit
      ? name
      : null;
  };

  // ---- how it looks
  function ring(context, pen, name, turned, strong) {
    const pose = begun(name),
      r = radius(name),
      path = new Path2D(),
      from = -Math.PI / 2,
      to = from + (turned * Math.PI) / 180;
    path.arc(pose.x, pose.y, r, 0, 2 * Math.PI);
    pen.stroke(path, "#fff", 1, 0.35, [2, 5]);
    const arc = new Path2D(),
      knob_ = new Path2D(),
      [x, y] = [pose.x + r * Math.cos(to), pose.y + r * Math.sin(to)];
    if (turned) {
      arc.arc(pose.x, pose.y, r, from, to, turned < 0);
      pen.stroke(arc, strong ? INKS.force : INKS.velocity, 2.4);
    }
    knob_.arc(x, y, KNOB * pen.unit, 0, 2 * Math.PI);
    pen.stroke(knob_, "#fff", 2);
    pen.fill(knob_, strong ? INKS.force : INKS.velocity);
  }
  function draw(context, pen) {
    if (!scene() || !editor.player.run || !pushes.per) return;
    const tool = editor.tool?.name === "push",
      late = editor.player.time > 1e-6,
      drag = dragging.drag && dragging.moved ? shown : null;
    if (editor.player.playing) return;
    for (const arrow of arrows()) {
      if (drag && drag.kind === arrow.kind && drag.name === arrow.name) continue;
      const mine = editor.selected?.name === arrow.name || (editor.selected?.kind === "force" && editor.selected.name === arrow.index);
      const ink = arrow.kind === "velocity" ? INKS.velocity : INKS.force;
      pen.arrow(arrow.x, arrow.y, arrow.dx, arrow.dy, ink, late ? 0.4 : 1, mine ? 3.4 : 2.2);
      if (tool && !late && long(arrow)) {
        const grip = new Path2D();
        grip.arc(arrow.x + arrow.dx, arrow.y + arrow.dy, 5 * pen.unit, 0, 2 * Math.PI);
        pen.stroke(grip, ink, 1.6, mine ? 1 : 0.6);
      }
    }
    for (const { kind, name, angle, index } of turns()) {
      if (drag?.name === name && drag.kind === kind) continue;
      const { x, y } = begun(name),
        r = reach(name) + (kind === "spin" ? 7 : 13) * pen.unit,
        arc = new Path2D(),
        from = -Math.PI / 2,
        to = from + (clamp(angle, -330, 330) * Math.PI) / 180;
      const ink = kind === "spin" ? INKS.velocity : INKS.force,
        strong = editor.selected?.kind === "force" && editor.selected.name === index,
        way = Math.sign(angle) * 9 * pen.unit;
      arc.arc(x, y, r, from, to, angle < 0);
      pen.stroke(arc, ink, strong ? 3.4 : 2.2, late ? 0.4 : 1);
      pen.arrow(x + r * Math.cos(to), y + r * Math.sin(to), -way * Math.sin(to), way * Math.cos(to), ink, late ? 0.4 : 1);
    }
    if (!tool) return;
    if (drag) {
      const ink = drag.kind === "velocity" || drag.kind === "spin" ? INKS.velocity : INKS.force;
      if (drag.ring !== null) ring(context, pen, drag.name, drag.ring, drag.kind === "torque");
      else pen.arrow(drag.x, drag.y, drag.dx, drag.dy, ink, 1, 3.6);
      const down = drag.dy >= 0 ? 1 : -1,
        top = drag.ring === null ? drag.y + drag.dy + 20 * down * pen.unit : drag.y - radius(drag.name) - 22 * pen.unit;
      label(pen, drag.text, drag.x + drag.dx, top);
    } else if (selected() && !late) ring(context, pen, selected(), (object(selected()).spin || 0) / TURNS, false);
  }
  // beside the arrow, and never out of the window
  function label(pen, text, x, y) {
    const [w, h] = [part("over").clientWidth, part("over").clientHeight],
      half = text.length * 3.6 + 12;
    const [sx, sy] = stage().screen([x, y]),
      { view } = stage();
    const cx = clamp(sx, half, Math.max(w - half, half)),
      cy = clamp(sy, 60, h - 16);
    pen.words(text, (cx - view.x) / view.scale - 0.5, (cy - view.y) / view.scale - 0.5, "#fff", { size: 13 });
  }
  editor.overlay(draw);

  // ---- the buttons of the kinds, for those who hold no key
  const kinds = element(
    "div",
    { class: "strip", role: "group", "aria-label": "What a drag gives", hidden: true },
    ...KINDS.map(({ kind, name, held }) =>
      element(
        "button",
        {
          type: "button",
          class: "chip",
          "data-push": kind,
          "aria-pressed": kind === chosen,
          title: held ? `${name}: or hold ${held}` : name,
          on: { click: () => choose(kind) },
        },
        name,
        held ? element("kbd", { "aria-hidden": "true" }, held) : null,
      ),
    ),
  );
  part("beside").append(kinds);
  function choose(kind) {
    chosen = kind;
    for (const made of kinds.children) made.setAttribute("aria-pressed", made.dataset.push === kind);
  }
  editor.on("tool", (tool) => {
    kinds.hidden = tool.name !== "push";
  });

  editor.registerTool({
    name: "push",
    label: "Push",
    key: "p",
    icon: "M4 11h11.2l-4-4L12.6 5.6 19 12l-6.4 6.4-1.4-1.4 4-4H4z",
    cursor: "default",
    cursorAt: (point) => (tipAt(point) || onKnob(point) ? "grab" : stage().hovered?.kind === "object" ? "crosshair" : "default"),
    down(point, event, hit) {
      const finger = event.pointerType === "touch",
        turn = onKnob(point, finger),
        tip = editor.player.time < 1e-6 ? tipAt(point, finger) : null;
      if (turn) {
        beginTurn(turn, point);
        return;
      }
      if (tip) {
        editor.choose(tip.index === undefined ? { kind: "object", name: tip.name } : { kind: "force", name: tip.index });
        beginPush(tip.name, point, tip);
        return;
      }
      const under = hit?.kind === "object" ? hit : stage().hit(point, { kinds: ["object"], finger }) || hit;
      editor.choose(under);
      if (under?.kind !== "object") return;
      if (pinned(under.name)) {
        editor.say(`${under.name} does not move by itself: set its motion to dynamic to push it`);
        return;
      }
      beginPush(under.name, point, null);
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
    // arrow keys: a step of the chosen push, or of the object's velocity
    nudge([dx, dy], { shiftKey, altKey }) {
      const entry = editor.selected,
        large = shiftKey ? 25 : 5;
      if (entry?.kind === "force") {
        const item = scene().forces[entry.name],
          kind = item.impulse ? "impulse" : item.force ? "force" : null;
        if (!kind) return false;
        const by = step(kind === "impulse" ? mass(item.object) : mass(item.object) / lasts(item)) * large;
        return repeated(`force ${entry.name} ${large}`, [dx, dy], (v) => {
          const value = scene().forces[entry.name][kind].map((was, k) => rounded(was + v[k] * by, by));
          return changed([{ set: ["forces", entry.name, kind], value }], `${kind} on ${item.object}: ${value.join(", ")}`, `nudge ${entry.name}`);
        });
      }
      if (entry?.kind !== "object" || pinned(entry.name) || altKey) return false;
      const { name } = entry,
        by = step(1) * large;
      return repeated(`velocity ${name} ${large}`, [dx, dy], (v) => {
        const value = (object(name).velocity || [0, 0]).map((was, k) => rounded(was + v[k] * by, by));
        return changed(setting(editor, ["objects", name, "velocity"], value), `Velocity of ${name}: ${value.join(", ")} px/s`, `nudge ${name}`);
      });
    },
    // [ and ]: spin
    turn(by) {
      const name = selected();
      return (
        Boolean(name) &&
        repeated(`spin ${name}`, [by], ([turns]) => {
          const value = rounded((object(name).spin || 0) + turns * 45, 45);
          return changed(setting(editor, ["objects", name, "spin"], value), `Spin of ${name}: ${value} °/s`, `spin ${name}`);
        })
      );
    },
  });
  const changed = (ops, what, tag) => {
    editor.player.rewind();
    return { ops, what, tag };
  };
  editor.pushes = { words: short, kinds: KINDS, choose };
}
