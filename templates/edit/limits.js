// Limits of pins and motors: two handles around the pin, at the least and the largest angle of the first object.

import { INKS } from "./stage.js";
import { named, pathOf } from "./app.js";
import { rounded } from "./dragging.js";

const RADIUS = 52, // px of the screen, from the pin to its handles
  GRIP = 6,
  MOST = 180; // degrees: a handle goes no farther, numbers may

export function start(editor) {
  const stage = () => editor.stage,
    points = editor.grips;

  // the pin, its limits, and the direction from it to the first object, rad
  function limited(entry) {
    const item = entry?.kind === "joint" ? named(entry) : null,
      pin = item?.pivot || item?.motor;
    if (!pin || !item.limits) return null;
    const pose = stage().poseOf(item.objects[0], 0) || { x: pin[0], y: pin[1] - 1 },
      far = Math.hypot(pose.x - pin[0], pose.y - pin[1]);
    return { pin, limits: item.limits, base: far > 1 ? Math.atan2(pose.y - pin[1], pose.x - pin[0]) : 0 };
  }
  const angle = ({ base, limits }, k) => base + (Math.min(Math.max(limits[k], -MOST), MOST) * Math.PI) / 180;
  const handle = (own, k) => {
    const a = angle(own, k),
      r = RADIUS * stage().unit;
    return [own.pin[0] + r * Math.cos(a), own.pin[1] + r * Math.sin(a)];
  };
  // degrees from the first object's direction to a point; a handle stays on its own side
  function turned({ pin, base }, k, to, step) {
    const way = Math.atan2(to[1] - pin[1], to[0] - pin[0]) - base,
      degrees = rounded((Math.atan2(Math.sin(way), Math.cos(way)) * 180) / Math.PI, step),
      back = k ? degrees < -MOST / 2 : degrees > MOST / 2;
    if (back) return k ? MOST : -MOST;
    return k ? Math.max(degrees, 0) : Math.min(degrees, 0);
  }
  function dragged(entry, k) {
    let limits = null;
    return {
      to(to, event) {
        const own = limited(entry);
        if (!own) return null;
        limits = [...own.limits];
        limits[k] = turned(own, k, to, event?.shiftKey ? 15 : 1);
        return [{ set: [...pathOf(entry), "limits"], value: limits }];
      },
      describe: () => `${entry.name}: limits ${limits[0]}° to ${limits[1]}°`,
    };
  }

  editor.grips = {
    ...points,
    at(point, finger = false) {
      const entry = editor.selected,
        own = limited(entry),
        near = (finger ? 3 : 1.8) * GRIP * stage().unit;
      for (const k of own ? [1, 0] : []) {
        const [x, y] = handle(own, k);
        if (Math.hypot(x - point[0], y - point[1]) < near) return { drag: () => dragged(entry, k) };
      }
      return points.at(point, finger);
    },
    draw(context, pen) {
      points.draw(context, pen);
      const own = limited(editor.selected);
      if (!own) return;
      const [x, y] = own.pin,
        sector = new Path2D();
      sector.moveTo(x, y);
      sector.arc(x, y, RADIUS * pen.unit, angle(own, 0), angle(own, 1));
      sector.closePath();
      pen.fill(sector, INKS.joint, 0.18);
      pen.stroke(sector, INKS.joint, 1.5);
      for (const k of [0, 1]) {
        const grip = new Path2D();
        grip.arc(...handle(own, k), GRIP * pen.unit, 0, 2 * Math.PI);
        pen.stroke(grip, "#fff", 1.6);
        pen.fill(grip, INKS.accent);
      }
    },
  };
}
