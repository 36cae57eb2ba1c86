// One time for all clips in view: the slider, playing in step, and films that stand at the very frame.
const clock = part("clock"), seek = part("seek"), playing = { on: false, from: 0, since: 0, frame: 0 };
const SETTLE = 160; // ms after which films follow the slider
const DRIFT = 0.12; // s that a film may be off while it plays
let longest = 0, settling = 0;

const inView = () => [...shots.values()].filter(shot => shot.seen && !shot.alone && shot.box.isConnected);
const filmed = () => inView().filter(shot => shot.clip.kind === "video/mp4").slice(0, MOST_FILMS);

function setLongest(shown) {
  longest = Math.max(...shown.map(n => (clips[n].made ? lastOf(clips[n]) : 0)), 0);
  clock.hidden = longest <= 0;
  seek.max = longest;
  tellTime();
}

function tellTime() {
  const time = Math.min(state.time ?? 0, longest);
  seek.value = time;
  seek.setAttribute("aria-valuetext", `${time.toFixed(2)} s of ${longest.toFixed(2)} s`);
  part("time").innerHTML = `${time.toFixed(2)} <span class="whole">/ ${longest.toFixed(2)}</span> s`;
}

/* where the slider stands: films follow when it rests */
function setTime(time) {
  state.time = Math.min(Math.max(time, 0), longest);
  tellTime();
  settleSoon();
}

function settleSoon() {
  clearTimeout(settling);
  settling = setTimeout(settle, SETTLE);
}

function settle() {
  if (playing.on || state.time === null) return;
  writeState();
  for (const shot of filmed()) {
    const film = attach(shot), time = state.time;
    if (!film) continue;
    film.pause();
    const there = () => { if (state.time === time && !playing.on && shot.film === film) film.style.opacity = 1; };
    film.addEventListener("seeked", there, { once: true });
    film.currentTime = Math.min(time, lastOf(shot.clip)) + 0.25 / shot.clip.fps; // within the frame, not at its edge
  }
}

function startAll() {
  if (state.time === null || state.time >= longest - 1e-3) setTime(0);
  clearTimeout(settling);
  Object.assign(playing, { on: true, from: state.time, since: performance.now() });
  part("play").setAttribute("aria-pressed", "true");
  part("play").setAttribute("aria-label", "Pause all");
  playing.frame = requestAnimationFrame(tick);
}
function stopAll() {
  if (!playing.on) return;
  playing.on = false;
  cancelAnimationFrame(playing.frame);
  part("play").setAttribute("aria-pressed", "false");
  part("play").setAttribute("aria-label", "Play all");
  for (const shot of shots.values()) if (!shot.alone) shot.film?.pause?.();
  settle();
}

function tick() {
  const rate = Number(part("rate").value);
  let time = playing.from + (rate * (performance.now() - playing.since)) / 1000;
  if (time > longest + 0.6 * rate) { // the end is held for a moment, then round again
    time = 0;
    Object.assign(playing, { from: 0, since: performance.now() });
  }
  state.time = Math.min(time, longest);
  tellTime();
  for (const shot of filmed()) {
    const film = attach(shot), end = lastOf(shot.clip);
    if (!film || film.readyState < 2 || film.seeking) continue;
    const due = Math.min(state.time, end);
    if (Math.abs(film.currentTime - due) > DRIFT * Math.max(rate, 0.25)) film.currentTime = due;
    else film.style.opacity = 1;
    film.playbackRate = rate;
    if (state.time < end) { if (film.paused) film.play().catch(() => {}); } else film.pause();
  }
  playing.frame = requestAnimationFrame(tick);
}
