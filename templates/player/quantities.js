// Motion -> what charts show: series of values at every sample, in g, px and s.

function readQuantities(data, motion) {
  const { times, bodies } = motion, count = times.length;
  const filled = (value) => Float64Array.from({ length: count }, (_, k) => value(k));
  const dynamic = bodies.filter((body) => body.motion === "dynamic");
  const energy = Object.fromEntries(["kinetic", "potential", "dissipated", "work"].map(
    (name) => [name, summed(data.energy[name], data.energy.step)]));
  const momentum = (column) => filled((k) => dynamic.reduce((sum, body) => sum + body.mass * body[column][k], 0));
  const [gx, gy] = data.gravity, pull = Math.hypot(gx, gy), [w, h] = data.size;
  // heights are over the picture's lowest corner, against gravity; without it, an object's distance from its start
  const corners = [[-0.5, -0.5], [w - 0.5, -0.5], [-0.5, h - 0.5], [w - 0.5, h - 0.5]];
  const lowest = pull ? Math.max(...corners.map(([x, y]) => (x * gx + y * gy) / pull)) : 0;
  const height = (body, k) => (pull
    ? lowest - (body.x[k] * gx + body.y[k] * gy) / pull
    : Math.hypot(body.x[k] - body.x[0], body.y[k] - body.y[0]));
  const way = (body) => {
    let sum = 0;
    for (let k = 1; k < count; k += 1) sum += Math.hypot(body.x[k] - body.x[k - 1], body.y[k] - body.y[k - 1]);
    return sum;
  };
  const objects = bodies.map((body, k) => ({ k, name: body.name, label: body.label, way: way(body) }));
  const order = [...objects].sort((a, b) => b.way - a.way); // those that move farthest have colours of their own
  const kept = new Map();
  const once = (key, make) => { if (!kept.has(key)) kept.set(key, make()); return kept.get(key); };
  return {
    energy,
    worked: energy.work.some((value) => Math.abs(value) > data.energy.step),
    momentum: { right: momentum("vx"), down: momentum("vy") },
    speed: (k) => once(`s${k}`, () => filled((n) => Math.hypot(bodies[k].vx[n], bodies[k].vy[n]))),
    height: (k) => once(`h${k}`, () => filled((n) => height(bodies[k], n))),
    falls: pull > 0,
    objects,
    movers: order.filter((o) => o.way > 0.5).slice(0, 4).map((o) => o.k),
    ranks: objects.map((o) => order.indexOf(o)),
  };
}
