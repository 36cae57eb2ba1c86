// The page's parts tied together.
const list = part("cards");
const cards = all(":scope > .clip", list);
let order = cards.map((_, n) => n);

function redraw() {
  const shown = chosen(), here = new Set(shown);
  const narrowed = state.q || asked();
  const lost = shown.filter(n => clips[n].failed).length, of = narrowed ? ` of ${clips.length}` : "";
  part("status").replaceChildren(`${shown.length}${of} clip${clips.length === 1 ? "" : "s"}`, ...(lost ? [", ", make("span", { className: "bad", text: `${lost} failed` })] : []));
  part("nothing").hidden = shown.length > 0;
  part("filters").hidden = !asked();
  part("filters").textContent = asked();
  part("filters").setAttribute("aria-label", `${asked()} in use`);
  part("reset").hidden = !narrowed;
  const grid = data.swept && state.view === "grid" && AXES.length > 0;
  list.hidden = grid;
  sheet.hidden = !grid;
  for (const element of all("[data-only]")) element.hidden = (element.dataset.only === "grid") !== grid;
  for (const button of all("[data-view]")) button.setAttribute("aria-pressed", String((button.dataset.view === "grid") === grid));
  if (!grid) {
    cards.forEach((card, n) => { if (card.hidden === here.has(n)) card.hidden = !here.has(n); });
    if (shown.some((n, k) => n !== order[k]) || order.length !== shown.length) {
      const sorted = state.sort || state.desc ? [...shown, ...clips.keys()].filter((n, k, every) => k < shown.length || !here.has(n)) : [...clips.keys()];
      if (sorted.some((n, k) => list.children[k] !== cards[n])) list.append(...sorted.map(n => cards[n]));
      order = shown;
    }
  }
  if (grid && state.time === null) state.time = Math.max(...shown.map(n => (clips[n].made ? lastOf(clips[n]) : 0)), 0); // outcomes
  if (grid) drawSheet(shown); else for (const box of all(".shot", sheet)) forgetShot(box);
  setLongest(shown);
  writeState();
}

/* what stands in the controls follows the state */
function fillIn() {
  part("search").value = state.q;
  part("sort").value = state.sort;
  part("desc").setAttribute("aria-pressed", String(state.desc));
  const [x, y] = axes();
  part("x").value = x?.path ?? "";
  part("y").value = y?.path ?? "-";
  for (const name of SETS) for (const box of all(`[data-${name}]`)) if (box.type === "checkbox") box.checked = state[name].has(box.dataset[name]);
  for (const set of all("[data-key]")) {
    const path = set.dataset.key, key = keys.find(key => key.path === path);
    for (const box of all("[data-value]", set)) box.checked = Boolean(state.picks.get(path)?.has(box.dataset.value));
    const ends = all("input[data-end]", set);
    if (ends.length) {
      const range = state.ranges.get(path) ?? [-Infinity, Infinity];
      ends[0].value = Math.max(key.values.findIndex(value => value >= range[0]), 0);
      ends[1].value = key.values.findLastIndex(value => value <= range[1]);
      tellRange(set, key, ends);
    }
  }
}

function tellRange(set, key, ends) {
  all("output", set).forEach((output, k) => {
    output.textContent = key.texts[ends[k].value];
    ends[k].setAttribute("aria-valuetext", output.textContent);
  });
}

function options(select, rows) {
  select.replaceChildren(...rows.map(([value, text]) => make("option", { value, text })));
}

function prepare() {
  const twice = (axis, k, every) => every.filter(other => other.name === axis.name).length > 1 ? `${axis.name} (${axis.path})` : axis.name;
  options(part("sort"), [["", "folder"], ["=name", "name"], ["=time", "time made"], ["=objects", "objects"], ["=duration", "duration"], ...keys.map(key => [key.path, key.name])]);
  const rows = AXES.map((axis, k, every) => [axis.path, twice(axis, k, every)]);
  options(part("x"), rows);
  options(part("y"), [...rows, ["-", "nothing"]]);
  document.querySelector(".switch").hidden = !data.swept;
  if (innerWidth < 760) part("facets").open = false;

  part("search").addEventListener("input", event => { state.q = event.target.value; redraw(); });
  for (const name of ["sort", "x", "y"]) part(name).addEventListener("change", event => { state[name] = event.target.value; fillIn(); redraw(); });
  part("desc").addEventListener("click", () => { state.desc = !state.desc; fillIn(); redraw(); });
  for (const button of all("[data-view]")) button.addEventListener("click", () => { state.view = button.dataset.view; redraw(); });
  const clear = () => { state.q = ""; for (const name of SETS) state[name].clear(); state.picks.clear(); state.ranges.clear(); fillIn(); redraw(); };
  for (const name of ["reset", "all"]) part(name).addEventListener("click", () => { clear(); part("search").focus(); });

  part("facets").addEventListener("input", event => {
    const box = event.target, set = box.closest("[data-key]");
    const flip = (chosen, value) => (box.checked ? chosen.add(value) : chosen.delete(value));
    if (set && box.dataset.end) {
      const path = set.dataset.key, key = keys.find(key => key.path === path), ends = all("input[data-end]", set);
      const [low, high] = ends.map(end => Number(end.value));
      if (low > high) box.value = box === ends[0] ? high : low;
      tellRange(set, key, ends);
      const whole = Number(ends[0].value) === 0 && Number(ends[1].value) === key.values.length - 1;
      if (whole) state.ranges.delete(path); else state.ranges.set(path, ends.map(end => key.values[end.value]));
    } else if (set) {
      const path = set.dataset.key;
      if (!state.picks.has(path)) state.picks.set(path, new Set());
      flip(state.picks.get(path), box.dataset.value);
    } else {
      const name = SETS.find(name => name in box.dataset);
      if (name) flip(state[name], box.dataset[name]);
    }
    redraw();
  });

  seek.addEventListener("input", () => { stopAll(); setTime(Number(seek.value)); });
  seek.addEventListener("keydown", event => {
    const step = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10 }[event.key];
    if (!step || event.altKey || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    stopAll();
    setTime((state.time ?? 0) + step * frameTime());
  });
  part("play").addEventListener("click", () => (playing.on ? stopAll() : startAll()));
  part("rate").addEventListener("change", () => Object.assign(playing, { from: state.time ?? 0, since: performance.now() }));

  cards.forEach((card, n) => {
    const box = card.firstElementChild;
    if (box.classList.contains("shot") && clips[n].poster) makeShot(box, n, shot => { addRun(shot); addSlide(box); });
  });
  const hero = part("hero");
  if (hero) {
    const shot = makeShot(hero.firstElementChild, Number(hero.dataset.n), () => { addSlide(hero.firstElementChild); if (!still.matches) playAlone(shot); });
    hero.addEventListener("click", event => { if (!event.target.closest("a")) (shot.alone ? stopAlone : playAlone)(shot); });
  }
  for (const open of all("a.open, .hero figcaption a")) open.href = withWayBack(open.getAttribute("href"));
  attend();
  list.addEventListener("keydown", walk);
  addEventListener("hashchange", () => { readState(); fillIn(); redraw(); settleSoon(); });
}

/* the address of a report, which then knows this page, and by it the clips before and after */
function withWayBack(href) {
  const folders = href.match(/^\.\/((?:[^/]+\/)*)[^/]+$/)?.[1];
  const name = location.pathname.split("/").pop() || "index.html";
  return folders === undefined ? href : `${href}?gallery=${"../".repeat(folders.split("/").length - 1)}${name}`;
}

const frameTime = () => 1 / Math.max(...clips.map(clip => (clip.made ? clip.fps : 0)), 1);

/* a button to play a clip, for fingers; made when the card comes into view */
function addRun(shot) {
  if (!shot.clip.kind) return;
  const button = make("button", { type: "button", className: "run", tabIndex: -1 });
  button.innerHTML = part("play").innerHTML;
  button.setAttribute("aria-label", `Play ${shot.clip.name}`);
  button.setAttribute("aria-pressed", "false");
  shot.box.append(button);
}

/* a card plays while a pointer or the focus is on it; `pointed` is that card */
let pointed = null;
function attend() {
  const shotOf = card => shots.get(card?.firstElementChild);
  const stop = () => { if (pointed) stopAlone(pointed); pointed = null; };
  const soon = card => {
    if (shotOf(card) === pointed) return;
    stop();
    pointed = shotOf(card) ?? null;
    if (pointed && !still.matches && !playing.on) pointed.wait = setTimeout(playAlone, WAIT, pointed);
  };
  list.addEventListener("pointerover", event => { if (event.pointerType === "mouse") soon(event.target.closest(".clip")); });
  list.addEventListener("pointerleave", event => { if (event.pointerType === "mouse") stop(); });
  list.addEventListener("focusin", event => { if (event.target.matches(".open:focus-visible")) soon(event.target.closest(".clip")); });
  list.addEventListener("focusout", stop);
  list.addEventListener("click", event => {
    const card = event.target.closest(".clip"), shot = shotOf(card);
    if (shot && (event.target.closest(".run") || (event.target.closest(".shot") && !event.target.closest("a, button")))) { if (shot.alone) stopAlone(shot); else playAlone(shot); }
    if (event.target.closest("button.open")) look([Number(card.dataset.n)]);
  });
}

/* keys on a card: arrows go to its neighbours, space plays it */
function walk(event) {
  const card = event.target.closest(".clip");
  if (!card || !event.target.classList.contains("open") || event.altKey || event.ctrlKey || event.metaKey) return;
  if (event.key === " ") {
    const shot = shots.get(card.firstElementChild);
    if (!shot) return;
    event.preventDefault();
    if (shot.alone) stopAlone(shot); else playAlone(shot);
    return;
  }
  const shown = all(":scope > .clip:not([hidden])", list), at = shown.indexOf(card);
  const wide = Math.max(shown.findIndex(other => other.offsetTop > shown[0].offsetTop), 1);
  const step = { ArrowLeft: -1, ArrowRight: 1, ArrowUp: -wide, ArrowDown: wide, Home: -at, End: shown.length - 1 - at }[event.key];
  if (step === undefined) return;
  event.preventDefault();
  const next = shown[at + step]?.querySelector(".open");
  next?.focus();
  next?.scrollIntoView({ block: "nearest" });
}

if (clips.length) {
  readState();
  prepare();
  fillIn();
  redraw();
}
part("page").focus({ preventScroll: true }); // its keys scroll at once
document.documentElement.dataset.ready = "";
