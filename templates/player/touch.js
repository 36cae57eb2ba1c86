// Shapes at their poses -> where two of them are nearest: one or two points, and the gap, px.
// The same rule as physgen.render.contacts.contact_points_between: points of one contact differ by little in their gaps.

const CIRCLES = 0.15, FACES = 0.75, APART = 3;

function edgesOf(data, bodies, poses, surface) {
  const edges = [];
  if (surface >= bodies.length) {
    for (const chain of data.walls[surface - bodies.length].chains)
      for (let k = 0; k + 1 < chain.length; k += 1) edges.push([...chain[k], ...chain[k + 1]]);
    return edges;
  }
  const { x, y, a } = poses[surface], c = Math.cos(a), s = Math.sin(a);
  for (const ring of bodies[surface].rings) {
    const points = ring.map(([px, py]) => [c * px - s * py + x, s * px + c * py + y]);
    points.forEach((point, k) => edges.push([...point, ...points[(k + 1) % points.length]]));
  }
  return edges;
}

function nearestOn([x1, y1, x2, y2], x, y) {
  const wx = x2 - x1, wy = y2 - y1;
  const along = clamp(((x - x1) * wx + (y - y1) * wy) / Math.max(wx * wx + wy * wy, 1e-12), 0, 1);
  const nx = x1 + along * wx, ny = y1 + along * wy;
  return [nx, ny, Math.hypot(x - nx, y - ny)];
}

function endsOf(found, slack) {
  const least = Math.min(...found.map((row) => row[2]));
  const near = found.filter((row) => row[2] <= least + slack);
  const middle = [0, 1].map((k) => near.reduce((sum, row) => sum + row[k], 0) / near.length);
  const far = (from) => near.reduce((best, row) =>
    Math.hypot(row[0] - from[0], row[1] - from[1]) > Math.hypot(best[0] - from[0], best[1] - from[1]) ? row : best);
  const end = far(middle), other = far(end);
  const two = Math.hypot(end[0] - other[0], end[1] - other[1]) >= APART;
  return { gap: least, points: two ? [end.slice(0, 2), other.slice(0, 2)] : [middle] };
}

function touching(data, bodies, poses, first, second) {
  const round = (k) => (k < bodies.length && bodies[k].radius !== undefined ? { ...poses[k], r: bodies[k].radius } : null);
  const one = round(first), other = round(second);
  if (one && other) {
    const wx = other.x - one.x, wy = other.y - one.y, far = Math.max(Math.hypot(wx, wy), 1e-9);
    const gap = far - one.r - other.r, along = (one.r + gap / 2) / far;
    return { gap, points: [[one.x + wx * along, one.y + wy * along]] };
  }
  if (one || other) {
    const disc = one || other;
    const found = edgesOf(data, bodies, poses, one ? second : first).map((edge) => {
      const [x, y, away] = nearestOn(edge, disc.x, disc.y);
      return [x, y, away - disc.r];
    });
    return endsOf(found, CIRCLES);
  }
  const edges = edgesOf(data, bodies, poses, first), others = edgesOf(data, bodies, poses, second), found = [];
  for (const [mine, theirs] of [[edges, others], [others, edges]])
    for (const [x1, y1, x2, y2] of mine)
      for (const edge of theirs) found.push(nearestOn(edge, x1, y1), nearestOn(edge, x2, y2));
  return endsOf(found, FACES);
}
