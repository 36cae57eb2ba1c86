// Motion from the server -> a run that can be played: the one of the file, the one of an edit that is tried, the one before.

import { element, part } from "./elements.js";
import { ask } from "./api.js";

const HELD = 700; // ms that the end of a run is seen before the page goes back by itself
const RATES = [2, 1, 1 / 2, 1 / 4, 1 / 8, 1 / 16];
const OWN = [
  { key: "w", id: "ways", name: "Paths", ink: "#ffc233" },
  { key: "g", id: "before", name: "Previous motion", ink: "#c4c8d2" },
  { key: "s", id: "shadows", name: "Shadows", ink: "#556" },
  { key: "u", id: "masses", name: "Masses", ink: "#fff" },
];
const NOT = new Set(["trails", "forces"]);

const doubles = (text) => new Float64Array(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);
const COLUMNS = ["x", "y", "a", "vx", "vy", "w"];

// a first answer and those that follow it, joined -> what readMotion and makeLayers read
function joined(kept, more) {
  const bodies = more.bodies.map((body, k) => {
    const before = kept?.bodies[k] || body,
      found = { ...before };
    for (const name of COLUMNS) found[name] = longer(kept && before[name], doubles(body[name]));
    const rests = (c) => new Float64Array(kept.upto).fill(c ? 0 : 1); // a ball that had not turned until now
    found.q = body.q
      ? body.q.map((turns, c) => longer(kept && (before.q?.[c] || rests(c)), doubles(turns)))
      : before.q && kept
        ? before.q.map((turns, c) => longer(turns, new Float64Array(more.upto - kept.upto).fill(c ? 0 : 1)))
        : undefined;
    return found;
  });
  const base = kept || { impacts: [], touches: [], pushes: [], joints: [], fields: [], walls: [], camera: null, ...more };
  const every = kept ? kept.every : doubles(more.times),
    frames = kept ? kept.allFrames : more.frames;
  return {
    ...base,
    bodies,
    every,
    allFrames: frames,
    key: more.key,
    upto: more.upto,
    total: more.total,
    done: more.done,
    steps: {},
    times: every.subarray(0, more.upto),
    frames: frames.filter((sample) => sample < more.upto),
    touches: more.contacts?.touches || base.touches,
    clip: { ...base.clip, order: "forward" },
  };
}
function longer(one, other) {
  if (!one) return other;
  const both = new Float64Array(one.length + other.length);
  both.set(one);
  both.set(other, one.length);
  return both;
}

function makeRun(data) {
  const motion = readMotion(data),
    clip = readClip(data, motion),
    units = readUnits(data);
  const names = data.bodies.map((body) => body.name),
    index = new Map(names.map((name, k) => [name, k]));
  const layers = makeLayers(
    data,
    motion,
    clip,
    units,
    names.map((_, k) => k),
  ).filter((layer) => !NOT.has(layer.id));
  units.grams = (mass) => (mass >= 1000 ? `${+(mass / 1000).toPrecision(3)} kg` : `${+mass.toPrecision(3)} g`);
  return { data, motion, clip, units, layers, names, index, end: data.every[data.total - 1] ?? motion.end };
}

export function start(editor) {
  const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
  const shown = new Set(["outlines", "boundaries", "joints", "shadows", "ways", "before"]);
  const seen = new Map();
  let clock = null,
    own = null,
    rate = null,
    loop = true,
    chips = "",
    other = null,
    showing = false, // plays once by itself, from the beginning and back to it
    ended = 0;

  const player = (editor.player = {
    run: null, // what is shown
    before: null, // the run before the last edit
    get own() {
      return own;
    }, // the run of the file
    get other() {
      return other;
    }, // a run to compare with, of another variant
    trying: false, // whether what is shown is an edit that is not made yet
    shown,
    get time() {
      return clock ? clock.time : 0;
    },
    get playing() {
      return Boolean(clock?.playing);
    },
    at(run, time) {
      const where = run.motion.locate(Math.min(time, run.motion.end));
      // masks are those of the photo: while they are corrected, objects are where it shows them
      const photo = editor.tool?.name === "mask";
      const pose = (body) => (photo && body.rest ? { x: body.rest[0], y: body.rest[1], a: body.rest[2] } : run.motion.pose(body, where));
      return { time, where, poses: run.motion.bodies.map(pose) };
    },
    now: () => player.at(player.run, player.time),
    get showing() {
      return showing;
    },
    play() {
      taken();
      clock?.play();
    },
    pause() {
      taken();
      clock?.pause();
    },
    toggle() {
      taken();
      clock?.toggle();
    },
    step(frames) {
      taken();
      clock?.step(frames);
    },
    seek(time) {
      taken();
      clock?.seek(time);
    },
    rewind() {
      taken();
      clock?.pause();
      clock?.seek(0);
    },
    again() {
      taken();
      clock?.seek(0);
      if (still) tell();
      else clock?.play();
    },
    // what a push did: once, and back to where the next one can be made
    once() {
      player.rewind();
      if (still || !clock) return;
      showing = true;
      clock.loop = false;
      clock.play();
      if (!clock.playing) taken();
    },
    faster(by) {
      const all = rates();
      clock.rate = rate = all[clamp(all.indexOf(clock.rate) - by, 0, all.length - 1)];
      tell();
    },
    loop() {
      loop = !loop;
      taken();
      clock.loop = loop;
    },
    toggleLayer(id) {
      if (shown.has(id)) shown.delete(id);
      else shown.add(id);
      buttons(true);
      editor.redraw();
    },
  });

  // ---- runs
  function show(run, trying) {
    const time = player.time,
      playing = player.playing;
    clock?.pause();
    player.run = run;
    player.trying = trying;
    const made = (clock = makeClock(run.clip, (change) => {
      tell();
      if (showing && change.wrapped && clock === made && run.data.done) back();
    }));
    if (rate !== null) clock.rate = rate;
    else clock.rate = nearest(run.clip.pace);
    clock.loop = loop && !showing;
    clock.seek(Math.min(time, run.motion.end));
    // of what plays by itself the rest may have come after its end
    if (playing || (showing && time < run.motion.end - 1e-6)) clock.play();
    else if (showing && run.data.done) back();
    part("seek").max = run.end || 0;
    buttons();
    editor.emit("motion", run);
  }
  // whoever plays, stops or seeks has the player again
  function taken() {
    clearTimeout(ended);
    if (!showing) return;
    showing = false;
    if (clock) clock.loop = loop;
  }
  function back() {
    clearTimeout(ended);
    ended = setTimeout(() => showing && player.rewind(), HELD);
  }
  // the rest of a long run, while it is still the one that is wanted
  async function rest(run, wanted, trying) {
    if (trying) await new Promise((done) => setTimeout(done, 150)); // a newer one may come
    while (!run.data.done && wanted(run)) {
      if (trying && editor.pending) return; // it is made already
      let more;
      try {
        more = await ask("GET", `/api/motion/${run.data.key}?from=${run.data.upto}`);
      } catch {
        return;
      }
      if (!wanted(run)) return;
      const next = makeRun(joined(run.data, more));
      if (!trying) own = next;
      if (player.run === run) show(next, trying);
      run = next;
    }
    if (!trying && wanted(run)) editor.emit("whole", run);
  }
  editor.on("state", ({ state, before }) => {
    if (!state.motion) {
      player.stale = true;
      editor.redraw();
      return;
    }
    player.stale = false;
    if (own && own.data.key === state.motion.key && !player.trying) {
      editor.redraw();
      return;
    }
    const run = makeRun(joined(null, state.motion));
    if (own && own.data.key !== state.motion.key && before) player.before = own;
    own = run;
    show(run, false);
    editor.watched = rest(run, (mine) => own === mine, false);
  });
  editor.on("preview", (found) => {
    if (!found) {
      if (player.trying && own) show(own, false);
      return;
    }
    if (!found.motion) return;
    const run = makeRun(joined(null, found.motion));
    show(run, true);
    rest(run, (mine) => player.run === mine && player.trying, true);
  });

  editor.on("ghost", (found) => {
    other = found?.motion ? makeRun(joined(null, found.motion)) : null;
    editor.redraw();
  });

  // ---- controls
  const named = (r) => (r >= 1 ? `${r}×` : `1/${Math.round(1 / r)}×`);
  const rates = () => RATES;
  const nearest = (pace) => RATES.reduce((best, r) => (Math.abs(Math.log(r / pace)) < Math.abs(Math.log(best / pace)) ? r : best));
  part("rate").append(...RATES.map((r) => element("option", { value: String(r) }, named(r))));
  for (const [name, run] of Object.entries({
    play: player.toggle,
    back: () => player.step(-1),
    next: () => player.step(1),
    again: player.again,
    loop: player.loop,
    first: player.rewind,
  }))
    part(name).addEventListener("click", run);
  part("rate").addEventListener("change", () => {
    if (clock) clock.rate = rate = +part("rate").value;
  });
  part("seek").addEventListener("input", () => {
    player.pause();
    player.seek(+part("seek").value);
  });
  part("seek").addEventListener("keydown", (event) => {
    const by = { ArrowLeft: -1, ArrowRight: 1, ArrowDown: -1, ArrowUp: 1 }[event.key];
    if (by) {
      player.step(by);
      event.preventDefault();
      event.stopPropagation();
    }
  });
  function tell() {
    const time = player.time,
      seek = part("seek");
    seek.value = time;
    seek.style.setProperty("--part", `${player.run.end ? (100 * time) / player.run.end : 0}%`);
    seek.setAttribute("aria-valuetext", `${time.toFixed(3)} s`);
    part("time").textContent = time.toFixed(3);
    part("play").setAttribute("aria-label", player.playing ? "Pause" : "Play");
    part("play").classList.toggle("playing", player.playing);
    part("loop").setAttribute("aria-pressed", loop);
    part("rate").value = String(clock.rate);
    document.body.dataset.time = time.toFixed(6);
    editor.emit("time", time);
    editor.redraw();
  }
  function buttons(anew = false) {
    for (const layer of player.run.layers) seen.set(layer.id, layer); // what was there once stays a button
    const all = [...seen.values(), ...OWN],
      now = all.map((layer) => layer.id).join();
    if (now !== chips) {
      part("layers").replaceChildren(
        ...all.map(({ id, key, name, ink }) => {
          const swatch = element("i", { class: "swatch" });
          swatch.style.setProperty("--ink", ink);
          return element(
            "button",
            {
              type: "button",
              class: "chip",
              "data-layer": id,
              title: `${name} (Shift ${key.toUpperCase()})`,
              "aria-keyshortcuts": `Shift+${key.toUpperCase()}`,
              on: { click: () => player.toggleLayer(id) },
            },
            swatch,
            name,
          );
        }),
      );
      chips = now;
    } else if (!anew) return;
    for (const chip of part("layers").children) chip.setAttribute("aria-pressed", shown.has(chip.dataset.layer));
  }
}
