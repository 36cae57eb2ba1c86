// One object is selected: outlined in the picture, thick in the charts, marked in the table.

const NEAR = 6; // px of the photo by which a click may miss an object

function makeSelection(data, motion, quantities) {
  const { bodies } = motion, listeners = [];
  let selected = null;

  const speed = (body) => (body.motion === "dynamic" ? Math.hypot(body.vx[0], body.vy[0]) : 0);
  function pushed() {
    if (data.pushes.length) return data.pushes[0].body;
    const fastest = bodies.reduce((best, body, k) => (speed(body) > speed(bodies[best]) ? k : best), 0);
    if (bodies.length && speed(bodies[fastest]) > 0) return fastest;
    return quantities.movers[0] ?? (bodies.length ? 0 : null);
  }

  // the way from a point to a body: 0 inside, else px to its outline's corners or circle
  function distance(body, pose, x, y) {
    const cos = Math.cos(pose.a), sin = Math.sin(pose.a), dx = x - pose.x, dy = y - pose.y;
    const px = cos * dx + sin * dy, py = cos * dy - sin * dx;
    if (body.radius !== undefined) return Math.max(Math.hypot(px, py) - body.radius, 0);
    let inside = false, near = Infinity;
    for (const ring of body.rings) {
      ring.forEach(([x1, y1], n) => {
        const [x0, y0] = ring[n ? n - 1 : ring.length - 1];
        if ((y0 > py) !== (y1 > py) && px < x0 + ((py - y0) / (y1 - y0)) * (x1 - x0)) inside = !inside;
        near = Math.min(near, Math.hypot(px - x1, py - y1));
      });
    }
    return inside ? 0 : near;
  }
  const nearest = [...new Set([...data.sprites.map((sprite) => sprite.body).reverse(), ...bodies.keys()])]; // first
  function at(x, y, time) {
    const where = motion.locate(time);
    const ways = nearest.map((k) => ({ k, way: distance(bodies[k], motion.pose(bodies[k], where), x, y) }));
    const best = ways.reduce((a, b) => (b.way < a.way ? b : a), { k: null, way: NEAR });
    return best.k;
  }

  const outline = (body) => (body.radius !== undefined
    ? `M${-body.radius} 0a${body.radius} ${body.radius} 0 1 0 ${2 * body.radius} 0a${body.radius} ${body.radius} 0 1 0 ${-2 * body.radius} 0Z`
    : body.rings.map((ring) => `M${ring.map((point) => point.join(" ")).join("L")}Z`).join(""));
  // puts the outline into a drawing over the picture; `view` is the part of the photo that is seen
  function mark(svg, time, view) {
    const path = svg.firstElementChild, body = bodies[selected];
    if (!body) { path.removeAttribute("d"); return; }
    const pose = motion.pose(body, motion.locate(time));
    if (path.dataset.body !== String(selected)) { path.setAttribute("d", outline(body)); path.dataset.body = selected; }
    path.setAttribute("transform", `translate(${pose.x.toFixed(2)} ${pose.y.toFixed(2)}) rotate(${((180 * pose.a) / Math.PI).toFixed(2)})`);
    if (view) svg.setAttribute("viewBox", view.join(" "));
  }

  function set(k) {
    if (k === selected) return;
    selected = k;
    for (const listener of listeners) listener(k);
  }
  return { get k() { return selected; }, set, at, mark, pushed, listen: (listener) => listeners.push(listener) };
}

// Rows of the table of parameters: a click or their button selects an object, and the selected one's is marked.
function tieTable(table, bodies, selection) {
  const rows = [...table.querySelectorAll("tr[data-names]")].map((row) => {
    const names = JSON.parse(row.dataset.names), indices = names.map((name) => bodies.findIndex((body) => body.name === name)).filter((k) => k >= 0);
    return { row, indices };
  }).filter(({ indices }) => indices.length);
  for (const { row, indices } of rows) {
    const name = row.querySelector("th b"), button = tag("button", { type: "button", class: "link name" });
    button.append(...name.childNodes);
    name.append(button);
    row.addEventListener("click", () => { if (!indices.includes(selection.k)) selection.set(indices[0]); });
  }
  selection.listen((k) => {
    for (const { row, indices } of rows) {
      row.classList.toggle("selected", indices.includes(k));
      row.querySelector("button.name").setAttribute("aria-pressed", indices.includes(k));
    }
  });
}
