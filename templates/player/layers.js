// What can be drawn over the scene: each layer is a key, a name and a drawing. Pens are px of the screen.

const INK = {
  boundaries: "rgb(240 150 195)", pieces: "rgb(255 255 255)", velocity: "rgb(40 225 165)", force: "rgb(255 122 61)",
  weight: "rgb(214 174 255)", contacts: "rgb(255 255 255)", joints: "rgb(150 232 90)", fields: "rgb(255 172 80)",
};
const OBJECTS = ["#5b9dff", "#ffc233", "#ff7d6b", "#6fd6c0", "#5cc46b", "#ff9cc4", "#b98aff", "#a9c7ff", "#d29a72", "#c4c8d2"];
const HALO = "rgb(0 0 0 / 0.6)";
const FLASH = 8, FADE = 0.5, NAMES = 22;

function makePen(context, scale) {
  const pen = {
    unit: 1 / scale, // px of the photo that a px of the screen is
    stroke(path, colour, width = 1.6, alpha = 1, dash = []) {
      context.globalAlpha = alpha;
      context.lineJoin = context.lineCap = "round";
      context.setLineDash([]);
      context.strokeStyle = HALO;
      context.lineWidth = (width + 2) / scale;
      context.stroke(path);
      context.setLineDash(dash.map((d) => d / scale));
      context.strokeStyle = colour;
      context.lineWidth = width / scale;
      context.stroke(path);
      context.setLineDash([]);
      context.globalAlpha = 1;
    },
    line(path, colour, width, alpha = 1) {
      context.globalAlpha = alpha;
      context.lineJoin = "round";
      context.lineCap = "butt";
      context.strokeStyle = colour;
      context.lineWidth = width / scale;
      context.stroke(path);
      context.globalAlpha = 1;
    },
    fill(path, colour, alpha = 1) {
      context.globalAlpha = alpha;
      context.fillStyle = colour;
      context.fill(path);
      context.globalAlpha = 1;
    },
    arrow(x, y, dx, dy, colour, alpha = 1, width = 2.2) {
      const long = Math.hypot(dx, dy);
      if (long * scale < 3) return;
      const head = Math.min(8 / scale, 0.5 * long), ux = dx / long, uy = dy / long, path = new Path2D(), tip = new Path2D();
      path.moveTo(x, y);
      path.lineTo(x + dx - 0.8 * head * ux, y + dy - 0.8 * head * uy);
      tip.moveTo(x + dx, y + dy);
      tip.lineTo(x + dx - head * ux - 0.55 * head * uy, y + dy - head * uy + 0.55 * head * ux);
      tip.lineTo(x + dx - head * ux + 0.55 * head * uy, y + dy - head * uy - 0.55 * head * ux);
      tip.closePath();
      pen.stroke(path, colour, width, alpha);
      pen.stroke(tip, colour, 1, alpha);
      pen.fill(tip, colour, alpha);
    },
    words(text, x, y, colour, { pill = true, size = 12 } = {}) {
      context.save();
      context.translate(x, y);
      context.scale(1 / scale, 1 / scale);
      context.font = `600 ${size}px system-ui, "Segoe UI", Roboto, "Noto Sans", sans-serif`;
      context.textAlign = "center";
      context.textBaseline = "middle";
      if (pill) {
        const wide = context.measureText(text).width + 10;
        context.fillStyle = "rgb(15 18 22 / 0.72)";
        context.beginPath();
        context.roundRect(-wide / 2, -size * 0.8, wide, size * 1.6, 4);
        context.fill();
      }
      context.fillStyle = colour;
      context.fillText(text, 0, 0.5);
      context.restore();
    },
  };
  return pen;
}

function lineOf(points, closed = false) {
  const path = new Path2D();
  points.forEach(([x, y], k) => (k ? path.lineTo(x, y) : path.moveTo(x, y)));
  if (closed) path.closePath();
  return path;
}

const cut = (text) => { const signs = [...text]; return signs.length > NAMES ? `${signs.slice(0, NAMES - 1).join("")}…` : text; };

// The layers of a scene; `now` is {time, where, poses}; ranks say whose turn each object has among the colours.
function makeLayers(data, motion, clip, units, ranks) {
  const colourOf = (k) => OBJECTS[ranks[k] % OBJECTS.length];
  const bodies = motion.bodies, arrows = data.arrows;
  const flash = Math.min((FLASH * clip.pace) / clip.fps, motion.end / 6) || 0;
  const turned = ({ x, y, a }, points) => {
    const c = Math.cos(a), s = Math.sin(a);
    return points.map(([px, py]) => [c * px - s * py + x, s * px + c * py + y]);
  };

  function outlines(pen, now) {
    bodies.forEach((body, k) => {
      if (now.hidden?.has(k)) return;
      const pose = now.poses[k], path = new Path2D();
      if (body.radius !== undefined) {
        path.arc(pose.x, pose.y, body.radius, 0, 2 * Math.PI);
        if (!(data.top && body.ball)) {
          const [from, to] = turned(pose, [[0.72 * body.radius, 0], [body.radius, 0]]);
          path.moveTo(...from);
          path.lineTo(...to);
        }
      } else body.rings.forEach((ring) => path.addPath(lineOf(turned(pose, ring), true)));
      pen.stroke(path, colourOf(k), 1.8, 1, body.motion === "dynamic" ? [] : [5, 4]);
    });
  }

  function pieces(pen, now) {
    bodies.forEach((body, k) => (body.pieces || []).forEach((piece) => {
      const path = lineOf(turned(now.poses[k], piece), true);
      pen.fill(path, colourOf(k), 0.16);
      pen.stroke(path, INK.pieces, 0.9, 0.85);
    }));
  }

  function boundaries(pen) {
    for (const wall of data.walls) for (const chain of wall.chains) pen.stroke(lineOf(chain), INK.boundaries, 2.2);
  }

  function camera(pen, now) {
    const [left, top, w, h] = data.camera[Math.round(clip.frameAt(now.time))];
    pen.stroke(lineOf([[left, top], [left + w, top], [left + w, top + h], [left, top + h]], true), "#fff", 1.4, 0.9, [7, 5]);
  }

  function velocities(pen, now) {
    bodies.forEach((body, k) => {
      const { x, y } = now.poses[k];
      const vx = motion.mix(body.vx, now.where), vy = motion.mix(body.vy, now.where);
      pen.arrow(x, y, arrows.velocity * vx, arrows.velocity * vy, INK.velocity);
    });
  }

  // the scene's pushes while they act, an impulse for a moment; and weights
  function forces(pen, now) {
    const [gx, gy] = data.gravity;
    bodies.forEach((body, k) => {
      const scale = body.motion === "dynamic" ? arrows.force * body.mass : 0;
      pen.arrow(now.poses[k].x, now.poses[k].y, scale * gx, scale * gy, INK.weight);
    });
    for (const push of data.pushes) {
      const struck = push.load === "impulse", end = struck ? push.start + flash : push.end;
      if (now.time < push.start - 1e-9 || now.time >= end - 1e-9) continue;
      const pose = now.poses[push.body], [[x, y]] = turned(pose, [push.at]);
      const left = struck ? clamp(1.6 * (1 - (now.time - push.start) / flash), 0, 1) : 1;
      if (push.load === "torque") {
        const body = bodies[push.body], around = body.radius || Math.max(...body.rings.flat().map((p) => Math.hypot(...p)));
        const sweep = arrows.torque * push.torque, path = new Path2D(), r = 1.25 * around;
        path.arc(pose.x, pose.y, r, -Math.PI / 2, -Math.PI / 2 + sweep, sweep < 0);
        pen.stroke(path, INK.force, 2.2);
        const tip = -Math.PI / 2 + sweep, way = Math.sign(sweep) * 10 * pen.unit;
        pen.arrow(pose.x + r * Math.cos(tip), pose.y + r * Math.sin(tip), -way * Math.sin(tip), way * Math.cos(tip), INK.force);
      } else {
        const scale = struck ? arrows.impulse : arrows.force;
        pen.arrow(x, y, scale * push.vector[0], scale * push.vector[1], INK.force, left, struck ? 3.4 : 2.2);
      }
    }
  }

  // a dot at each contact, a ring at each recent impact; its area is the impulse
  function contacts(pen, now) {
    const time = now.time + 1e-9, dots = new Path2D();
    for (const [first, second, begin, end] of data.touches) {
      if (begin > time) break;
      if (end !== null && end < now.time) continue;
      const { points, gap } = touching(data, bodies, now.poses, first, second);
      if (gap < 2) for (const [x, y] of points) {
        dots.moveTo(x + 3 * pen.unit, y);
        dots.arc(x, y, 3 * pen.unit, 0, 2 * Math.PI);
      }
    }
    pen.stroke(dots, INK.contacts, 0.5);
    pen.fill(dots, INK.contacts);
    const shown = data.impacts.filter(([at]) => at <= time && time < at + flash);
    const written = []; // the strongest have their impulses beside them, as far as there is room
    for (const [at, x, y, impulse] of shown.sort((a, b) => b[3] - a[3])) {
      const r = Math.sqrt(arrows.ring * impulse), left = clamp(1.6 * (1 - (now.time - at) / flash), 0, 1);
      if (r < 3 * pen.unit) continue;
      const ring = new Path2D();
      ring.arc(x, y, r, 0, 2 * Math.PI);
      pen.stroke(ring, INK.contacts, 1.8, left);
      const above = y - r - 11 * pen.unit;
      const free = written.every(([wx, wy]) => Math.abs(wx - x) > 76 * pen.unit || Math.abs(wy - above) > 20 * pen.unit);
      if (written.length < 3 && left > 0.35 && free) {
        pen.words(units.worded("impulse", impulse), x, above, "#fff", { size: 11 });
        written.push([x, above]);
      }
    }
  }

  // samples at which an object has moved by a pixel
  const steps = bodies.map((body) => {
    const kept = [0];
    for (let i = 1; i < motion.times.length; i += 1) {
      const k = kept[kept.length - 1];
      if (Math.hypot(body.x[i] - body.x[k], body.y[i] - body.y[k]) > 1) kept.push(i);
    }
    return kept;
  });

  function trails(pen, now) {
    const PARTS = 5, span = FADE * motion.end || 1;
    bodies.forEach((body, k) => {
      const points = steps[k].filter((i) => motion.times[i] <= now.time).map((i) => [body.x[i], body.y[i], motion.times[i]]);
      points.push([now.poses[k].x, now.poses[k].y, now.time]);
      if (points.length < 3) return;
      pen.line(lineOf(points), HALO, 3.8, 0.5);
      for (let part = 0, from = 0; part < PARTS; part += 1) { // older parts are fainter
        const until = now.time - (span * (PARTS - 1 - part)) / PARTS;
        let to = from;
        while (to + 1 < points.length && (part === PARTS - 1 || points[to + 1][2] <= until)) to += 1;
        if (to > from) pen.line(lineOf(points.slice(from, to + 1)), colourOf(k), 1.8, 0.28 + (0.72 * (part + 1)) / PARTS);
        from = to;
      }
    });
  }

  function joints(pen, now) {
    for (const joint of data.joints) {
      const [first] = turned(now.poses[joint.first], [joint.ends[0]]);
      const second = joint.second === null ? joint.ends[1] : turned(now.poses[joint.second], [joint.ends[1]])[0];
      if (joint.kind === "spring") pen.stroke(lineOf([first, second]), INK.joints, 2.4, 1, [5, 4]);
      else {
        const rods = [joint.first, joint.second].filter((k) => k !== null);
        for (const k of rods) pen.stroke(lineOf([first, [now.poses[k].x, now.poses[k].y]]), INK.joints, 1.4, 0.8);
      }
      for (const [x, y] of [first, second]) {
        const pin = new Path2D();
        pin.arc(x, y, 3.5 * pen.unit, 0, 2 * Math.PI);
        pen.stroke(pin, INK.joints, 1);
        pen.fill(pin, INK.joints);
      }
    }
    data.fields.forEach((field, k) => {
      const [w, h] = data.size, [x, y] = field.vector;
      if (field.wind) {
        const long = Math.hypot(x, y) || 1, reach = 0.1 * Math.hypot(w, h);
        pen.arrow(0.05 * w, (h * (0.5 + k)) / data.fields.length, (reach * x) / long, (reach * y) / long, INK.fields);
      } else {
        const ring = new Path2D();
        for (const r of [6, 11]) { ring.moveTo(x + r * pen.unit, y); ring.arc(x, y, r * pen.unit, 0, 2 * Math.PI); }
        pen.stroke(ring, INK.fields, 1.8);
      }
    });
  }

  function names(pen, now) {
    const [w, h] = data.size;
    bodies.forEach((body, k) => {
      const { x, y } = now.poses[k];
      if (x > 0 && y > 0 && x < w && y < h) pen.words(cut(body.name), x, y, "#fff");
    });
  }

  // in the order in which they are drawn
  return [
    { key: "b", id: "boundaries", name: "Boundaries", ink: INK.boundaries, draw: boundaries, there: data.walls.length },
    { key: "t", id: "trails", name: "Trails", ink: OBJECTS[1], draw: trails, there: bodies.length },
    { key: "p", id: "pieces", name: "Convex pieces", ink: INK.pieces, draw: pieces, there: bodies.some((b) => (b.pieces || []).length) },
    { key: "o", id: "outlines", name: "Outlines", ink: OBJECTS[0], draw: outlines, there: bodies.length },
    { key: "j", id: "joints", name: data.fields.length ? "Joints and fields" : "Joints", ink: INK.joints, draw: joints, there: data.joints.length + data.fields.length },
    { key: "f", id: "forces", name: "Forces", ink: INK.force, draw: forces, there: bodies.length && (data.pushes.length || Math.hypot(...data.gravity) > 0) },
    { key: "v", id: "velocities", name: "Velocities", ink: INK.velocity, draw: velocities, there: bodies.length },
    { key: "c", id: "contacts", name: "Contacts", ink: INK.contacts, draw: contacts, there: data.touches.length },
    { key: "k", id: "camera", name: "Camera", ink: "#fff", draw: camera, there: data.camera },
    { key: "i", id: "ids", name: "Names", ink: "#fff", draw: names, there: bodies.length },
  ].filter((layer) => layer.there);
}
