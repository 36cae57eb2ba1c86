// Series over one time axis -> SVG with a cursor; hovering reads values, a click or a drag seeks.

const SVG = "http://www.w3.org/2000/svg";
const READ = 2; // digits beside the charts
const GUTTER = 56, EDGE = 10, TOP = 8, FOOT = 22;

function shape(name, attributes = {}, ...children) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children);
  return element;
}

function tag(name, attributes = {}, ...children) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children);
  return element;
}

// Two upright lines over a chart: the player's time, and the one that is read. They are no part of the drawing, which
// would be painted again for every frame.
function markers() {
  const cursor = tag("i", { class: "cursor" }), reading = tag("i", { class: "reading" });
  const put = (line, x) => { line.style.transform = `translateX(${x.toFixed(1)}px)`; };
  return {
    elements: [cursor, reading],
    span(top, foot) {
      for (const line of [cursor, reading]) { line.style.top = `${top}px`; line.style.height = `${foot - top}px`; }
    },
    move: (x) => put(cursor, x),
    hover(x) {
      reading.classList.toggle("shown", x !== null);
      if (x !== null) put(reading, x);
    },
  };
}

// Hovering a plot reads the time that `at` returns for an event; pressing or dragging seeks it.
function pointed(plot, at, hovering, seek) {
  plot.addEventListener("pointermove", (event) => { hovering(at(event)); if (event.buttons & 1) seek(at(event)); });
  plot.addEventListener("pointerdown", (event) => { plot.setPointerCapture(event.pointerId); seek(at(event)); });
  plot.addEventListener("pointerleave", () => hovering(null));
  plot.addEventListener("pointercancel", () => hovering(null));
}

// `what`: {title, note, kind, tall, stacked, last, series(): [{name, colour, dash, values, also}]}
function makeChart(what, data, motion, units, seek, hovering) {
  const { times } = motion;
  const plot = shape("svg", { role: "img", class: "plot" });
  const list = tag("dl", { class: "readout" });
  const title = tag("h3", {}, what.title), unit = tag("span", { class: "unit" });
  title.append(" ", unit);
  const note = tag("p", { class: "note" }, what.note || "");
  const side = tag("div", { class: "side" }, title, ...(what.note ? [note] : []), list);
  const lines = markers();
  const element = tag("div", { class: "chart" }, side, tag("div", { class: "plot-frame" }, plot, ...lines.elements));
  let wide = 0, series = [], rows = [], scale = { per: 1, unit: "" };

  const across = (time) => GUTTER + (motion.end ? (time / motion.end) * (wide - GUTTER - EDGE) : 0);
  const timeAt = (x) => clamp((x - GUTTER) / Math.max(wide - GUTTER - EDGE, 1), 0, 1) * motion.end;

  function path(values, up, base) {
    let line = "";
    for (let k = 0; k < values.length; k += 1) line += `${k ? "L" : "M"}${across(times[k]).toFixed(1)} ${up(values[k]).toFixed(1)}`;
    if (!base) return line;
    for (let k = values.length - 1; k >= 0; k -= 1) line += `L${across(times[k]).toFixed(1)} ${up(base[k]).toFixed(1)}`;
    return `${line}Z`;
  }

  function frame(tall) {
    plot.replaceChildren();
    plot.setAttribute("viewBox", `0 0 ${wide} ${tall}`);
    plot.setAttribute("width", wide);
    plot.setAttribute("height", tall);
    for (const tick of ticksOf(0, motion.end || 0, wide < 520 ? 4 : 8)) {
      const x = across(tick), low = tall - (what.last ? FOOT : TOP);
      plot.append(shape("line", { class: "grid", x1: x, x2: x, y1: TOP, y2: low }));
      if (what.last) plot.append(shape("text", { class: "tick", x, y: tall - 6, "text-anchor": "middle" }, `${+tick.toFixed(6)} s`));
    }
  }

  function draw() {
    const tall = what.tall + (what.last ? FOOT - TOP : 0), foot = tall - (what.last ? FOOT : TOP);
    frame(tall);
    series = what.series();
    const sums = [];
    if (what.stacked) series.forEach((row, n) => {
      if (row.line) return;
      const below = sums.length ? sums[sums.length - 1].top : new Float64Array(times.length);
      sums.push({ n, below, top: below.map((value, k) => value + row.values[k]) });
    });
    const all = what.stacked ? [...sums.map((s) => s.top), ...series.filter((s) => s.line).map((s) => s.values)] : series.map((s) => s.values);
    let low = Math.min(0, ...all.map((v) => v.reduce((a, b) => Math.min(a, b), Infinity)));
    let high = Math.max(0, ...all.map((v) => v.reduce((a, b) => Math.max(a, b), -Infinity)));
    scale = units.axis(what.kind, Math.max(-low, high));
    unit.textContent = all.length ? scale.unit : "";
    if (!(high > low)) high = low + scale.per;
    const ticks = ticksOf(low / scale.per, high / scale.per, what.tall < 110 ? 3 : 4).map((v) => v * scale.per);
    const room = 0.04 * (high - low);
    if (low < 0) low -= room;
    high += room;
    const up = (value) => foot - ((value - low) / (high - low)) * (foot - TOP);
    for (const tick of ticks) {
      const y = up(tick), text = digits(+(tick / scale.per).toPrecision(10), 6).replace(/\.?0+$/, "") || "0";
      plot.append(shape("line", { class: Math.abs(tick) < 1e-12 ? "axis" : "grid", x1: GUTTER, x2: wide - EDGE, y1: y, y2: y }));
      plot.append(shape("text", { class: "tick", x: GUTTER - 8, y: y + 4, "text-anchor": "end" }, Number.isInteger(tick / scale.per) ? String(Math.round(tick / scale.per)).replace("-", "−") : text));
    }
    for (const { n, below, top } of sums) plot.append(shape("path", { class: "area", d: path(top, up, below), style: `fill: var(${series[n].colour})` }));
    series.forEach((row) => {
      if (what.stacked && !row.line) return;
      plot.append(shape("path", { class: `line${row.dash ? " dashed" : ""}${row.strong ? " strong" : ""}`, d: path(row.values, up), style: `stroke: var(${row.colour})` }));
    });
    if (!series.length) plot.append(shape("text", { class: "empty", x: (wide + GUTTER) / 2, y: (foot + TOP) / 2, "text-anchor": "middle" }, what.empty));
    lines.span(TOP, foot);
    rows = series.map((row) => {
      const value = tag("dd"), swatch = tag("i", { class: row.dash ? "swatch dashed" : "swatch", style: `--ink: var(${row.colour})` });
      return { row, value, name: tag("dt", {}, swatch, tag(row.strong ? "b" : "bdi", { dir: "auto" }, row.name)) };
    });
    list.replaceChildren(...rows.map(({ name, value }) => tag("div", {}, name, value)));
    requestAnimationFrame(() => { // with its values; keys scroll it
      if (list.scrollHeight > list.clientHeight) list.tabIndex = 0; else list.removeAttribute("tabindex");
    });
    const described = series.slice(0, 6).map((row) => {
      const ends = [row.values[0], row.values[row.values.length - 1]].map((v) => digits(v / scale.per));
      return `${row.name} from ${ends[0]} to ${ends[1]}`;
    });
    plot.setAttribute("aria-label", `${what.title}, ${scale.unit}, over ${digits(motion.end)} s. ${described.join("; ") || what.empty}`);
  }

  const at = (event) => timeAt(event.clientX - plot.getBoundingClientRect().left);
  pointed(plot, at, hovering, seek);

  return {
    element,
    draw,
    resize(width) { wide = width; draw(); },
    move: (time) => lines.move(across(time)),
    hover: (time) => lines.hover(time === null ? null : across(time)),
    read(time) {
      const where = motion.locate(time);
      for (const { row, value } of rows) {
        const found = motion.mix(row.values, where), also = units.both(what.kind, found);
        value.textContent = joined(found / scale.per, scale.unit, READ);
        value.dataset.value = found / scale.per;
        if (also && what.also) value.append(tag("small", {}, also));
      }
    },
  };
}

// Contacts as bars, impacts as ticks, on the same axis.
function makeLane(data, motion, units, seek, hovering, nameOf) {
  const TALL = 58, REACH = 7;
  const plot = shape("svg", { role: "img", class: "plot lane" });
  const current = tag("p", { class: "note now" });
  const side = tag("div", { class: "side" }, tag("h3", {}, "Contacts"), current);
  const lines = markers();
  const element = tag("div", { class: "chart" }, side, tag("div", { class: "plot-frame" }, plot, ...lines.elements));
  const strongest = Math.max(1e-300, ...data.impacts.map((impact) => impact[3]));
  let wide = 0;
  const across = (time) => GUTTER + (motion.end ? (time / motion.end) * (wide - GUTTER - EDGE) : 0);
  const timeAt = (x) => clamp((x - GUTTER) / Math.max(wide - GUTTER - EDGE, 1), 0, 1) * motion.end;
  const moments = [...data.touches.map((t) => t[2]), ...data.impacts.map((b) => b[0])].sort((a, b) => a - b);

  function draw() {
    plot.replaceChildren();
    plot.setAttribute("viewBox", `0 0 ${wide} ${TALL}`);
    plot.setAttribute("width", wide);
    plot.setAttribute("height", TALL);
    plot.append(shape("text", { class: "tick", x: GUTTER - 8, y: 22, "text-anchor": "end" }, "impacts"), shape("text", { class: "tick", x: GUTTER - 8, y: TALL - 9, "text-anchor": "end" }, "touch"));
    let touches = "", begins = "";
    for (const [, , begin, end] of data.touches) {
      const x1 = across(begin), x2 = across(Math.min(end === null ? motion.end : end, motion.end));
      touches += `M${x1.toFixed(1)} ${TALL - 13}H${Math.max(x2, x1 + 1.5).toFixed(1)}`;
      begins += `M${x1.toFixed(1)} ${TALL - 18}v10`;
    }
    plot.append(shape("line", { class: "axis", x1: GUTTER, x2: wide - EDGE, y1: TALL - 22, y2: TALL - 22 }));
    plot.append(shape("path", { class: "touches", d: touches || "M0 0" }), shape("path", { class: "begins", d: begins || "M0 0" }));
    for (const [time, , , impulse] of data.impacts) {
      const tall = 4 + 26 * Math.sqrt(impulse / strongest), x = across(time).toFixed(1);
      plot.append(shape("line", { class: "impact", x1: x, x2: x, y1: TALL - 22, y2: TALL - 22 - tall }));
    }
    lines.span(4, TALL);
    const impacts = data.impacts.length;
    plot.setAttribute("aria-label", `${data.touches.length} contacts and ${impacts} impact${impacts === 1 ? "" : "s"} over ${digits(motion.end)} s; they are listed in the table of contacts.`);
  }

  // clicks near a tick mean the tick
  const near = (x) => {
    const time = timeAt(x), best = moments.reduce((a, b) => (Math.abs(b - time) < Math.abs(a - time) ? b : a), Infinity);
    return Math.abs(across(best) - x) < REACH ? Math.min(best, motion.end) : time;
  };
  const at = (event) => near(event.clientX - plot.getBoundingClientRect().left);
  pointed(plot, at, hovering, seek);

  return {
    element,
    draw,
    resize(width) { wide = width; draw(); },
    move: (time) => lines.move(across(time)),
    hover: (time) => lines.hover(time === null ? null : across(time)),
    read(time) {
      const t = time + 1e-9, lasting = data.touches.filter(([, , begin, end]) => begin <= t && (end === null || end >= time));
      const slack = motion.end / 100, struck = data.impacts.filter(([at]) => Math.abs(at - time) < slack)
        .sort((a, b) => b[3] - a[3])[0];
      const parts = [`${lasting.length} touching now`];
      if (struck) parts.push(`${nameOf(struck[4])} and ${nameOf(struck[5])}: ${units.worded("impulse", struck[3])}`);
      else if (lasting.length) parts.push(lasting.slice(0, 2).map(([a, b]) => `${nameOf(a)} and ${nameOf(b)}`).join(", ") + (lasting.length > 2 ? ", …" : ""));
      current.textContent = parts.join(" · ");
    },
  };
}
