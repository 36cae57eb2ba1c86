// The page's elements and the data -> a player: everything above is put together and listens here.

function start(root, physics, data) {
  const $ = (name) => root.querySelector(`[data-part="${name}"]`);
  const motion = readMotion(data), clip = readClip(data, motion), units = readUnits(data);
  const quantities = readQuantities(data, motion);
  const canvas = $("canvas"), context = canvas.getContext("2d"), video = root.querySelector("video");
  const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
  const on = new Set(["shadows"]);
  let paint = null, charts = null, asked = false;
  const selection = makeSelection(data, motion, quantities), marks = [...root.querySelectorAll('[data-part="marked"]')];

  // ---- the video, the preview, or both
  let follow = () => {};
  const views = [...root.querySelectorAll("[data-view]")];
  for (const button of views) {
    button.addEventListener("click", (event) => {
      view(button.dataset.view);
      if (event.detail) button.blur(); // after a click of the mouse, space plays
    });
  }
  function view(name) {
    root.dataset.view = name;
    for (const button of views) button.setAttribute("aria-pressed", button.dataset.view === name);
    follow({ sought: true });
  }

  const clock = makeClock(clip, (change) => { follow(change); second.follow(); show(change); });
  const second = makeSecond(root, clock, clip);
  makeSplit(root, view);
  readGallery(root, document.querySelector("[data-part=ways]"));
  const film = $("film"), frames = film && film.dataset.frames;
  if (video) {
    video.removeAttribute("controls");
    video.addEventListener("click", (event) => pick(event, viewed()));
    video.addEventListener("error", missing);
    if (video.error) missing();
    const driver = followVideo(video, clip, clock, () => root.dataset.view !== "preview");
    clock.driver = driver;
    follow = driver.follow;
    video.addEventListener("loadeddata", () => follow({ sought: true }));
  } else if (frames) {
    film.addEventListener("click", (event) => pick(event, viewed()));
    follow = followFrames(film, frames, clip, clock);
  }
  // the part of the photo that the video shows, and a click into it: on an object it selects, elsewhere it plays
  const PHOTO = [-0.5, -0.5, ...data.size];
  const viewed = () => (data.camera ? data.camera[Math.round(clip.frameAt(clock.time))] : PHOTO);
  function pick(event, [left, top, wide, high]) {
    const box = event.currentTarget.getBoundingClientRect();
    const x = left + ((event.clientX - box.left) / box.width) * wide, y = top + ((event.clientY - box.top) / box.height) * high;
    const k = selection.at(x, y, clock.time);
    if (k === null) clock.toggle(); else selection.set(k);
  }
  function markSelected() {
    for (const svg of marks) selection.mark(svg, clock.time, svg.dataset.on === "clip" ? viewed() : null);
  }
  selection.listen((k) => {
    markSelected();
    const body = data.bodies[k];
    $("picked").replaceChildren(...(body ? ["Selected: ", tag("b", {}, tag("bdi", { dir: "auto" }, body.name)), ...(body.motion === "dynamic" ? [`, ${digits(body.mass, 2)} g`] : [])] : []));
  });
  function missing() {
    video.hidden = true;
    $("missing").hidden = false;
    view("preview");
  }

  // ---- the picture
  const layers = makeLayers(data, motion, clip, units, quantities.ranks);
  function resize() {
    const wide = canvas.parentElement.clientWidth, dense = Math.min(devicePixelRatio || 1, 3);
    const pixels = Math.max(1, Math.round(wide * dense));
    if (pixels !== canvas.width) {
      canvas.width = pixels;
      canvas.height = Math.max(1, Math.round((pixels * data.size[1]) / data.size[0]));
    }
    draw();
  }
  function draw() {
    if (!paint) return;
    const scale = canvas.width / data.size[0], pen = makePen(context, canvas.width / data.size[0] / (canvas.width / canvas.clientWidth || 1));
    const where = motion.locate(clock.time), poses = motion.bodies.map((body) => motion.pose(body, where));
    context.setTransform(scale, 0, 0, scale, 0.5 * scale, 0.5 * scale);
    context.imageSmoothingQuality = "medium";
    const now = { time: clock.time, where, poses };
    paint(context, now, on.has("shadows"));
    markSelected();
    for (const layer of layers) if (on.has(layer.id)) layer.draw(pen, now);
  }

  // ---- words and sliders
  const seek = $("seek"), time = $("time"), frame = $("frame"), announce = $("announce");
  seek.max = motion.end || 0;
  seek.disabled = clip.count < 2;
  const words = () => `${clock.time.toFixed(3)} s, frame ${Math.round(clip.frameAt(clock.time)) + 1} of ${clip.count}`;
  let spoken = 0;
  function show({ started, stopped, sought } = {}) {
    if (!asked) { asked = true; requestAnimationFrame(() => { asked = false; draw(); if (charts) charts.move(clock.time); }); }
    const t = clock.time;
    seek.value = t;
    seek.style.setProperty("--part", `${motion.end ? (100 * t) / motion.end : 0}%`);
    seek.setAttribute("aria-valuetext", words());
    time.textContent = t.toFixed(3);
    frame.textContent = Math.round(clip.frameAt(t)) + 1;
    root.dataset.time = t.toFixed(6);
    root.dataset.playing = clock.playing;
    $("play").setAttribute("aria-label", clock.playing ? "Pause" : "Play");
    $("play").classList.toggle("playing", clock.playing);
    $("loop").setAttribute("aria-pressed", clock.loop);
    $("rate").value = String(clock.rate);
    if (stopped || (sought && !clock.playing)) {
      clearTimeout(spoken);
      spoken = setTimeout(() => { announce.textContent = words(); }, 400);
    } else if (started) { clearTimeout(spoken); announce.textContent = "Playing"; }
  }

  // ---- controls
  const rates = [...new Set([2, 1, 1 / 2, 1 / 4, 1 / 8, 1 / 16, clip.pace].map((r) => +r.toPrecision(6)))].sort((a, b) => b - a);
  const pace = +clip.pace.toPrecision(6);
  const named = (r) => (r >= 1 ? `${+r.toPrecision(3)}×` : Number.isInteger(+(1 / r).toFixed(3)) ? `1/${Math.round(1 / r)}×` : `${+r.toPrecision(2)}×`);
  for (const r of rates) {
    const parts = [named(r), ...(r === 1 ? ["real time"] : []), ...(r === pace && pace !== 1 ? ["the video's"] : [])];
    $("rate").append(tag("option", { value: String(r) }, parts.join(" · ")));
  }
  clock.rate = pace;
  const faster = (by) => { clock.rate = rates[clamp(rates.indexOf(clock.rate) - by, 0, rates.length - 1)]; announce.textContent = `Speed ${named(clock.rate)}`; };
  const go = (to) => { clock.seek(to); };
  const commands = {
    play: clock.toggle, back: () => clock.step(-1), next: () => clock.step(1),
    first: () => { clock.pause(); go(0); }, last: () => { clock.pause(); go(motion.end); },
    loop: () => { clock.loop = !clock.loop; },
  };
  for (const [name, run] of Object.entries(commands)) $(name).addEventListener("click", run);
  $("rate").addEventListener("change", () => { clock.rate = +$("rate").value; });
  seek.addEventListener("input", () => go(+seek.value));
  canvas.addEventListener("click", (event) => pick(event, PHOTO));
  $("save").addEventListener("click", () => {
    const number = String(Math.round(clip.frameAt(clock.time)) + 1).padStart(4, "0"), where = motion.locate(clock.time);
    const seen = root.dataset.view !== "preview" && video && !video.hidden && video.readyState > 1 ? video : null;
    const draft = (fresh) => {
      fresh.translate(0.5, 0.5);
      paint(fresh, { time: clock.time, where, poses: motion.bodies.map((body) => motion.pose(body, where)) }, on.has("shadows"));
    };
    saveFrame(seen, data.size, draft, `${data.name}-${number}.png`, (text) => { announce.textContent = text; });
  });

  const toggles = [...layers, ...(data.shadows.length ? [{ key: "s", id: "shadows", name: "Shadows", ink: "#556" }] : [])];
  const pressed = (id) => $("layers").querySelector(`[data-layer="${id}"]`);
  function toggle(id) {
    if (root.dataset.view === "video") view("preview"); // it is drawn there
    if (on.has(id)) on.delete(id); else on.add(id);
    pressed(id).setAttribute("aria-pressed", on.has(id));
    keys();
    draw();
  }
  for (const { id, key, name, ink } of toggles) {
    const button = tag("button", { type: "button", class: "chip", "data-layer": id, "aria-pressed": on.has(id), "aria-keyshortcuts": key, title: `${name} (${key})` },
      tag("i", { class: "swatch", style: `--ink: ${ink}` }), name, tag("kbd", { "aria-hidden": "true" }, key));
    button.addEventListener("click", () => toggle(id));
    $("layers").append(button);
  }

  // how long the arrows are
  function keys() {
    const px = (canvas.clientWidth || 1) / data.size[0], longest = 0.09 * Math.max(...data.size), rows = [];
    const add = (layer, name, kind, scale, ink) => {
      if (!on.has(layer) || !(scale > 0)) return;
      const { per } = units.axis(kind, longest / scale), one = roundBelow(longest / scale / per) * per;
      rows.push(tag("span", { class: "length" }, tag("i", { style: `--long: ${(one * scale * px).toFixed(1)}px; --ink: ${ink}` }), `${name} ${units.worded(kind, one)}`));
    };
    add("velocities", "velocity", "speed", data.arrows.velocity, INK.velocity);
    if (data.pushes.some((p) => p.load === "force")) add("forces", "force", "force", data.arrows.force, INK.force);
    if (Math.hypot(...data.gravity)) add("forces", "weight", "force", data.arrows.force, INK.weight);
    if (data.pushes.some((p) => p.load === "impulse")) add("forces", "impulse", "impulse", data.arrows.impulse, INK.force);
    $("lengths").replaceChildren(...rows);
    $("lengths").hidden = !rows.length;
  }

  // ---- keys: single letters work where nothing is focused, or something of the player is, unless switched off
  const letters = Object.fromEntries(toggles.map(({ key, id }) => [key, () => toggle(id)]));
  const TENTH = motion.end / 10;
  const moves = {
    " ": commands.play, Home: commands.first, End: commands.last, ",": commands.back, ".": commands.next,
    ArrowLeft: () => go(clock.time - TENTH), ArrowRight: () => go(clock.time + TENTH), l: commands.loop,
    "[": () => faster(-1), "]": () => faster(1), ...letters,
    ...(views.length ? { d: () => view(root.dataset.view === "preview" ? "video" : "preview") } : {}),
  };
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || !$("keys").checked) return;
    const target = event.target, free = target === document.body || target === document.documentElement;
    const inside = root.contains(target) || physics.contains(target);
    const run = moves[event.key];
    if (!run || !(free || inside)) return;
    if (target.matches("input[type=range]") && target !== seek) return; // the seam of the photo has keys of its own
    if (target.matches("select, textarea, input:not([type=range]):not([type=checkbox])")) return;
    if ((event.key === " " || event.key === "Enter") && target.matches("button, summary, a, input[type=checkbox]")) return;
    if (target.matches("input[type=range]") && event.key.startsWith("Arrow")) clock.step(event.key === "ArrowRight" ? 1 : -1);
    else run();
    event.preventDefault();
  });

  // ---- physics
  charts = makePhysics(physics, data, motion, units, clock, go, { quantities, selection, frame: 1000 / clip.fps });
  for (const table of document.querySelectorAll("table.parameters")) tieTable(table, data.bodies, selection);

  // ---- begin
  return loadPictures(data).then((pictures) => {
    paint = makeScene(data, motion, pictures);
    root.classList.add("live");
    for (const element of document.querySelectorAll("[data-live]")) element.hidden = false;
    for (const element of root.querySelectorAll("[data-still]")) element.setAttribute("hidden", "");
    physics.hidden = !motion.bodies.length;
    for (const link of document.querySelectorAll('nav [href="#physics"]')) link.hidden = physics.hidden;
    let wide = 0;
    new ResizeObserver(() => { resize(); keys(); }).observe(canvas.parentElement);
    new ResizeObserver(([{ contentRect }]) => {
      if (contentRect.width !== wide) { wide = contentRect.width; charts.resize(); charts.move(clock.time); }
    }).observe(physics);
    resize();
    keys();
    show();
    charts.resize();
    charts.move(0);
    charts.read();
    selection.set(selection.pushed());
    follow({ sought: true });
    if (!still && clip.frames > 1) clock.play();
    root.dataset.ready = "true";
  });
}

function makePhysics(physics, data, motion, units, clock, go, { quantities, selection, frame }) {
  const $ = (name) => physics.querySelector(`[data-part="${name}"]`);
  const chosen = new Set(quantities.movers);
  if (!chosen.size) quantities.objects.slice(0, 3).forEach((o) => chosen.add(o.k));
  const surfaces = [...data.bodies, ...data.walls], nameOf = (k) => surfaces[k].name;
  const rank = quantities.ranks, colours = (k) => `--object-${rank[k] % 10}`;
  const some = (values) => () => quantities.objects.filter((o) => chosen.has(o.k)).map((o) => (
    { name: o.name, colour: colours(o.k), dash: rank[o.k] >= 10, strong: o.k === selection.k, values: values(o.k) }));
  const { energy, momentum } = quantities;
  let over = null, lastRead = 0;
  const hovering = (time) => { over = time; for (const chart of charts) chart.hover(time); read(); };
  const chart = (what) => makeChart(what, data, motion, units, go, hovering);
  const none = "choose an object above";
  const charts = [
    makeLane(data, motion, units, go, hovering, nameOf),
    chart({
      title: "Energy", kind: "energy", tall: 150, stacked: true, empty: "",
      note: quantities.worked ? "The sum changes by the work of forces." : "The sum is constant: energy only changes its form.",
      series: () => [
        { name: "kinetic", colour: "--kinetic", values: energy.kinetic },
        { name: "potential", colour: "--potential", values: energy.potential },
        { name: "dissipated", colour: "--dissipated", values: energy.dissipated },
        ...(quantities.worked ? [{ name: "work done", colour: "--work", dash: true, line: true, values: energy.work }] : []),
      ],
    }),
    chart({
      title: "Momentum", kind: "impulse", tall: 110, empty: "", note: "Of all moving objects together.",
      series: () => [
        { name: "to the right", colour: "--object-3", values: momentum.right },
        { name: data.top ? "down" : "downwards", colour: "--object-6", values: momentum.down },
      ],
    }),
    chart({ title: "Speed", kind: "speed", tall: 130, also: true, empty: none, series: some(quantities.speed) }),
    chart({
      title: quantities.falls ? "Height" : "Distance", kind: "length", tall: 130, also: true, last: true, empty: none,
      note: quantities.falls ? "Of the centre, above the bottom edge of the picture." : "Of the centre, from its start.", series: some(quantities.height),
    }),
  ];
  $("charts").replaceChildren(...charts.map((c) => c.element));

  const chips = quantities.objects.map((o) => {
    const chip = tag("button", { type: "button", class: "chip", "aria-pressed": chosen.has(o.k), title: o.label || o.name },
      tag("i", { class: rank[o.k] >= 10 ? "swatch dashed" : "swatch", style: `--ink: var(${colours(o.k)})` }), tag("bdi", { dir: "auto" }, o.name));
    chip.addEventListener("click", () => { // select it; once more leaves it out
      if (selection.k !== o.k) { selection.set(o.k); return; }
      selection.set(null);
      choose([...chosen].filter((k) => k !== o.k));
    });
    return chip;
  });
  $("objects").replaceChildren(...chips);
  $("choice").hidden = !chips.length;
  function choose(some_) {
    chosen.clear();
    some_.forEach((k) => chosen.add(k));
    chips.forEach((chip, k) => chip.setAttribute("aria-pressed", chosen.has(k)));
    charts.slice(-2).forEach((c) => c.draw());
    move(clock.time);
    read();
  }
  selection.listen((selected) => {
    chips.forEach((chip, k) => { if (k === selected) chip.setAttribute("aria-current", "true"); else chip.removeAttribute("aria-current"); });
    choose(selected === null || chosen.has(selected) ? [...chosen] : [...chosen, selected]);
  });
  $("all").addEventListener("click", () => choose(quantities.objects.map((o) => o.k)));
  $("movers").addEventListener("click", () => choose(quantities.movers));
  for (const button of document.querySelectorAll("button[data-seek]")) button.addEventListener("click", () => { clock.pause(); go(+button.dataset.seek); });

  function read() {
    const time = over === null ? clock.time : over;
    $("when").textContent = `${over === null ? "at" : "hovering at"} ${time.toFixed(3)} s`;
    for (const c of charts) c.read(time);
  }
  function move(time) {
    for (const c of charts) c.move(time);
    const now = performance.now();
    if (over === null && (!clock.playing || now - lastRead > 0.9 * frame)) { lastRead = now; read(); } // once a frame
  }
  const width = () => charts[0].element.querySelector(".plot-frame").clientWidth;
  return { move, read, resize: () => { const w = width(); if (w > 0) for (const c of charts) c.resize(w); } };
}

(() => {
  const root = document.getElementById("player"), physics = document.getElementById("physics");
  const source = document.getElementById("player-data");
  if (!root || !source) return;
  const failed = (error) => {
    const note = root.querySelector('[data-part="failed"]');
    note.textContent = `The player could not start (${error.message || error}). The picture and the video are still there.`;
    note.hidden = false;
  };
  try { start(root, physics, JSON.parse(source.textContent)).catch(failed); } catch (error) { failed(error); }
})();
