// The page's parts tied together: clips in view follow one time; methods can be left out.
const frameTime = () => 1 / Math.max(...clips.map(clip => clip.fps), 1);
const step = by => { stopAll(); setTime((state.time ?? 0) + by); };

for (const card of all(".clip[data-n]")) {
  const box = card.firstElementChild;
  if (box.querySelector(".poster")) makeShot(box, Number(card.dataset.n));
}
seek.addEventListener("input", () => { stopAll(); setTime(Number(seek.value)); });
part("play").addEventListener("click", () => (playing.on ? stopAll() : startAll()));
part("rate").addEventListener("change", () => Object.assign(playing, { from: state.time ?? 0, since: performance.now() }));

addEventListener("keydown", event => {
  if (!longest || event.altKey || event.ctrlKey || event.metaKey || event.target.matches?.("select")) return;
  const wide = event.target.closest?.(".scroll");
  if (wide && wide.scrollWidth > wide.clientWidth && event.key.startsWith("Arrow")) return; // its own scrolling
  if (event.key === " " && event.target.matches?.("summary, button, a, input:not([data-part=seek])")) return; // presses it
  const by = { ArrowLeft: -1, ArrowRight: 1, PageDown: -10, PageUp: 10 }[event.target === seek || event.key.startsWith("Arrow") ? event.key : ""];
  if (event.key === " ") { if (playing.on) stopAll(); else startAll(); }
  else if (by) step(by * frameTime());
  else if (event.key === "Home") step(-longest);
  else if (event.key === "End") step(longest);
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
  setLongest(all(".clip[data-n]:not([hidden])").map(card => Number(card.dataset.n)));
});

readState();
setLongest([...clips.keys()]);
if (state.time !== null) setTime(state.time);
document.documentElement.dataset.ready = "";
