// What of the scene is where: outlines as they stand now, and whatever is under a point of the photo.

import { named } from "./app.js";

const NEAR = 8,
  FINGER = 18; // px of the screen

export function makeHits(editor, view) {
  function pathOf(run, k, { x, y, a }) {
    const body = run.motion.bodies[k],
      path = new Path2D();
    if (body.radius !== undefined) {
      path.arc(x, y, body.radius, 0, 2 * Math.PI);
      path.moveTo(x + 0.6 * body.radius * Math.cos(a), y + 0.6 * body.radius * Math.sin(a));
      path.lineTo(x + body.radius * Math.cos(a), y + body.radius * Math.sin(a));
    } else for (const ring of body.rings) path.addPath(lineOf(turned(ring, { x, y, a }), true));
    return path;
  }
  function turned(points, { x, y, a }) {
    const c = Math.cos(a),
      s = Math.sin(a);
    return points.map(([px, py]) => [c * px - s * py + x, s * px + c * py + y]);
  }
  function poseOf(name, time) {
    const { run } = editor.player || {},
      k = run?.index.get(name);
    if (k === undefined) return null;
    return (time === undefined ? editor.player.now() : editor.player.at(run, time)).poses[k];
  }
  function ringsOf(name) {
    const { run } = editor.player,
      body = run?.motion.bodies[run.index.get(name)],
      pose = poseOf(name);
    if (!pose) return [];
    if (body.radius === undefined) return body.rings.map((ring) => turned(ring, pose));
    return [
      Array.from({ length: 32 }, (_, k) => [
        pose.x + body.radius * Math.cos((k * Math.PI) / 16),
        pose.y + body.radius * Math.sin((k * Math.PI) / 16),
      ]),
    ];
  }
  function centreOf(entry) {
    const rings = entry.kind === "object" ? null : pointsOf(entry).flat();
    if (entry.kind === "object") {
      const pose = poseOf(entry.name);
      return pose && [pose.x, pose.y];
    }
    return rings.length ? [0, 1].map((c) => rings.reduce((sum, p) => sum + p[c], 0) / rings.length) : null;
  }
  // chains of points of what is no object
  function pointsOf({ kind, name }) {
    const item = named({ kind, name });
    if (!item) return [];
    if (kind === "boundary") {
      const own = item.segment || item.polyline;
      return own ? [own] : editor.player.run?.data.walls.find((wall) => wall.name === name)?.chains || [];
    }
    if (kind === "joint") return [item.spring || item.slider || item.rope || item.pulley || [item.pivot || item.weld || item.motor].filter(Boolean)];
    if (kind === "field" && item.attractor) return [[item.attractor]];
    if (kind === "force") return item.at ? [[item.at]] : [[centreOf({ kind: "object", name: item.object })].filter(Boolean)];
    return [];
  }
  function outline(entry) {
    if (entry.kind === "object") {
      const { run } = editor.player || {},
        k = run?.index.get(entry.name);
      return k === undefined ? null : pathOf(run, k, editor.player.now().poses[k]);
    }
    const chains = pointsOf(entry);
    if (!chains.length) return null;
    const path = new Path2D();
    for (const chain of chains) {
      if (chain.length > 1) path.addPath(lineOf(chain));
      else
        for (const [x, y] of chain) {
          const r = 9 / view.scale;
          path.moveTo(x + r, y);
          path.arc(x, y, r, 0, 2 * Math.PI);
        }
    }
    return path;
  }
  const shapes = document.createElement("canvas").getContext("2d"); // for asking what holds a point
  function hit([x, y], { kinds = ["force", "joint", "field", "object", "boundary"], finger = false } = {}) {
    const { scene: there } = editor.state || {},
      reach = (finger ? FINGER : NEAR) / view.scale;
    if (!there) return null;
    const lines = (kind, all) => {
      let best = null;
      for (const name of Object.keys(all || {})) {
        if (kind === "force" && !all[name].at) continue;
        for (const chain of pointsOf({ kind, name: kind === "force" ? +name : name })) {
          const edges = chain.length > 1 ? chain.slice(1).map((p, k) => [...chain[k], ...p]) : chain.map((p) => [...p, ...p]);
          for (const edge of edges) {
            const away = nearestOn(edge, x, y)[2];
            if (away <= reach && (!best || away < best.away)) best = { kind, name: kind === "force" ? +name : name, away };
          }
        }
      }
      return best;
    };
    const objects = () => {
      const { run } = editor.player || {};
      if (!run) return null;
      const now = editor.player.now(),
        found = [];
      run.motion.bodies.forEach((body, k) => {
        if (editor.locked?.has(body.name) || editor.hidden?.has(body.name)) return;
        const pose = now.poses[k],
          rings = body.radius === undefined ? body.rings.map((ring) => turned(ring, pose)) : null;
        const inside = rings ? shapes.isPointInPath(pathOf(run, k, pose), x, y, "evenodd") : Math.hypot(pose.x - x, pose.y - y) <= body.radius;
        const away = inside
          ? 0
          : rings
            ? Math.min(...rings.flatMap((ring) => ring.map((p, n) => nearestOn([...p, ...ring[(n + 1) % ring.length]], x, y)[2])))
            : Math.hypot(pose.x - x, pose.y - y) - body.radius;
        if (away <= (finger ? reach : reach / 2))
          found.push({ kind: "object", name: body.name, away, layer: there.objects?.[body.name]?.layer || 0, mass: body.mass });
      });
      // the one that holds the point, the nearer one first, small before large
      return found.sort((one, other) => (one.away > 0) - (other.away > 0) || other.layer - one.layer || one.mass - other.mass)[0] || null;
    };
    for (const kind of kinds) {
      const found =
        kind === "object"
          ? objects()
          : lines(kind, { force: there.forces, joint: there.joints, field: there.fields, boundary: there.boundaries }[kind]);
      if (found) return { kind: found.kind, name: found.name };
    }
    return null;
  }
  return { hit, centreOf, poseOf, ringsOf, outline, pathOf };
}
