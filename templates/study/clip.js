// One clip on the stage: its film, round and round; the photo beside it; how long it has been looked at.
const film = part("film"), still = matchMedia("(prefers-reduced-motion: reduce)");
let address = "", since = null, spent = 0; // ms since it is looked at, and before that

function stage(name) {
  const clip = data.clips.find(clip => clip.name === name), scene = data.scenes[clip.scene];
  if (address) URL.revokeObjectURL(address);
  const bytes = Uint8Array.from(atob(document.getElementById(`film-${name}`).textContent), c => c.charCodeAt(0));
  address = URL.createObjectURL(new Blob([bytes], { type: "video/mp4" }));
  part("broken").hidden = true;
  film.style.aspectRatio = `${clip.size[0]} / ${clip.size[1]}`;
  film.src = address;
  if (still.matches) film.pause(); else play();
  part("photo").hidden = !scene.photo;
  if (scene.photo) part("photo").querySelector("img").src = scene.photo;
  part("asked").hidden = !scene.words;
  part("asked").querySelector("q").textContent = scene.words;
  spent = (own().answers[name]?.seconds ?? 0) * 1000;
  since = document.hidden ? null : performance.now();
}

const seconds = () => Math.round((spent + (since === null ? 0 : performance.now() - since)) / 100) / 10;
const play = () => film.play().catch(() => {});
const toggle = () => (film.paused ? play() : film.pause());

document.addEventListener("visibilitychange", () => {
  if (document.hidden && since !== null) { spent += performance.now() - since; since = null; }
  else if (!document.hidden && since === null) since = performance.now();
});
for (const event of ["play", "pause"]) film.addEventListener(event, () => { part("pause").textContent = film.paused ? "Play" : "Pause"; });
film.addEventListener("error", () => { if (film.getAttribute("src")) part("broken").hidden = false; });
film.addEventListener("click", toggle);
part("pause").addEventListener("click", toggle);
part("again").addEventListener("click", () => { film.currentTime = 0; play(); });
