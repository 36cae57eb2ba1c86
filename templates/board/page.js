// One time for the clips of all scenes: the slider, playing in step, and methods that can be left out.
const clock = part("clock"), seek = part("seek"), DRIFT = 0.12; // s that a clip may be off while it plays
const films = () => all(".clip:not([hidden]) video");
const lastOf = film => film.dataset.seconds - 1 / film.dataset.fps;
let time = 0, longest = 0, playing = 0, since = 0;

function setLongest() {
  longest = Math.max(...films().map(lastOf), 0);
  clock.hidden = longest <= 0;
  seek.max = longest;
  setTime(Math.min(time, longest));
}

function setTime(to) {
  time = Math.min(Math.max(to, 0), longest);
  seek.value = time;
  seek.setAttribute("aria-valuetext", `${time.toFixed(2)} s of ${longest.toFixed(2)} s`);
  part("time").textContent = `${time.toFixed(2)} / ${longest.toFixed(2)} s`;
  for (const film of films()) {
    const due = Math.min(time, lastOf(film)) + 0.25 / film.dataset.fps; // within the frame, not at its edge
    if (!playing || Math.abs(film.currentTime - due) > DRIFT) film.currentTime = due;
  }
}

function play(on) {
  cancelAnimationFrame(playing);
  playing = on ? requestAnimationFrame(tick) : 0;
  since = performance.now();
  if (on && time >= longest) setTime(0);
  part("play").setAttribute("aria-pressed", String(on));
  part("play").setAttribute("aria-label", on ? "Pause all" : "Play all");
  if (on) return;
  for (const film of films()) film.pause();
  setTime(time);
}

function tick(now) {
  playing = requestAnimationFrame(tick);
  const rate = Number(part("rate").value);
  setTime(time >= longest ? 0 : time + (rate * Math.max(now - since, 0)) / 1000); // at the end, round again
  since = Math.max(now, since);
  for (const film of films()) {
    film.playbackRate = rate;
    if (time >= lastOf(film)) film.pause();
    else if (film.paused) film.play().catch(() => {});
  }
}

seek.addEventListener("input", () => { const to = Number(seek.value); play(false); setTime(to); });
part("play").addEventListener("click", () => play(!playing));
addEventListener("keydown", event => {
  const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
  if (event.altKey || event.ctrlKey || event.metaKey || event.target.closest?.("select, .scroll")) return;
  if (event.key === " " && event.target.matches?.("summary, button, a, input:not([data-part=seek])")) return; // presses it
  if (event.key === " ") play(!playing);
  else if (by) { play(false); setTime(time + by / Math.max(...films().map(film => film.dataset.fps), 1)); }
  else if (event.key === "Home" || event.key === "End") { play(false); setTime(event.key === "Home" ? 0 : longest); }
  else return;
  event.preventDefault();
});
// pressed by a pointer, a button keeps no focus: space then plays, and presses nothing again
let pointed = false;
addEventListener("pointerdown", () => { pointed = true; }, true);
addEventListener("keydown", () => { pointed = false; }, true);
addEventListener("click", event => { if (pointed) event.target.closest?.("main button, [data-shown]")?.blur(); });
part("shown")?.addEventListener("change", () => {
  const there = new Set(all("[data-shown]").filter(box => box.checked).map(box => box.dataset.shown));
  for (const card of all(".clip[data-method]")) card.hidden = !there.has(card.dataset.method);
  document.documentElement.style.setProperty("--columns", Math.max(there.size, 1));
  setLongest();
});
setLongest();
document.documentElement.dataset.ready = "";
