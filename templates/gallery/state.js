// What is asked for <-> the address behind #, so that a view can be shared.
const data = JSON.parse(document.getElementById("data").textContent);
const clips = data.clips, keys = data.keys;
const part = name => document.querySelector(`[data-part=${name}]`);
const all = (what, within = document) => [...within.querySelectorAll(what)];
const START = data.grid ? "grid" : "cards";
const SETS = ["is", "label"];
const state = { q: "", sort: "", desc: false, view: START, x: "", y: "", time: null, is: new Set(), label: new Set(), picks: new Map(), ranges: new Map() };

function readState() {
  const params = new URLSearchParams(location.hash.slice(1));
  for (const name of ["q", "sort", "x", "y"]) state[name] = params.get(name) ?? "";
  state.desc = params.has("desc");
  state.view = ["cards", "grid"].includes(params.get("view")) ? params.get("view") : START;
  const time = parseFloat(params.get("t"));
  state.time = time >= 0 ? time : null;
  for (const name of SETS) state[name] = new Set(params.getAll(name));
  state.picks.clear();
  state.ranges.clear();
  for (const { path } of keys) {
    for (const text of params.getAll(`v.${path}`)) {
      const ends = text.match(/^(.+)\.\.(.+)$/)?.slice(1).map(Number);
      if (ends && ends.every(Number.isFinite)) state.ranges.set(path, ends);
      else state.picks.set(path, (state.picks.get(path) ?? new Set()).add(text));
    }
  }
}

function writeState() {
  const params = new URLSearchParams();
  for (const name of ["q", "sort", "x", "y"]) if (state[name]) params.set(name, state[name]);
  if (state.desc) params.set("desc", "");
  if (state.view !== START) params.set("view", state.view);
  for (const name of SETS) for (const value of state[name]) params.append(name, value);
  for (const [path, chosen] of state.picks) for (const value of chosen) params.append(`v.${path}`, value);
  for (const [path, [low, high]] of state.ranges) params.set(`v.${path}`, `${low}..${high}`);
  if (state.time !== null) params.set("t", state.time.toFixed(3));
  const hash = params.toString();
  if (hash !== location.hash.slice(1)) history.replaceState(null, "", `#${hash}`);
}

const asked = () => SETS.reduce((sum, name) => sum + state[name].size, 0) + [...state.picks.values()].filter(chosen => chosen.size).length + state.ranges.size;
