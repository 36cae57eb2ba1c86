// A clip's picture: its poster or its film. Nothing is loaded before it is wanted.
const still = matchMedia("(prefers-reduced-motion: reduce)");
const shots = new Map(); // box -> shot
const MOST_FILMS = 36; // that play at once
const HOLD = 900; // ms at the photo, before it moves again
const WAIT = 90; // ms that a pointer must stay

const watcher = new IntersectionObserver(entries => {
  for (const { target, isIntersecting } of entries) {
    const shot = shots.get(target);
    if (!shot) continue;
    shot.seen = isIntersecting;
    if (isIntersecting) shot.first?.(shot);
    if (isIntersecting) shot.first = null;
    if (isIntersecting) settleSoon(); else if (!shot.alone) drop(shot);
  }
}, { rootMargin: "150px" });

function makeShot(box, n, first = null) { // `first` is called when it is seen for the first time
  const shot = { box, n, first, clip: clips[n], seen: false, film: null, alone: false, wait: 0 };
  shots.set(box, shot);
  watcher.observe(box);
  return shot;
}
function forgetShot(box) {
  const shot = shots.get(box);
  if (!shot) return;
  drop(shot);
  watcher.unobserve(box);
  shots.delete(box);
}

const lastOf = clip => Math.max(clip.frames - 1, 0) / clip.fps;

const filmOf = n => clips[n].film;

/* the film of a shot, above its poster; unseen until it has a frame to show */
function attach(shot) {
  if (shot.film) return shot.film;
  const { clip, n } = shot, moves = clip.kind === "video/mp4";
  if (!clip.kind) return null;
  const film = document.createElement(moves ? "video" : "img");
  film.className = "film";
  film.style.opacity = 0;
  if (moves) {
    Object.assign(film, { muted: true, playsInline: true, preload: "auto", disablePictureInPicture: true, tabIndex: -1 });
    film.addEventListener("error", () => drop(shot));
  } else film.alt = "";
  film.src = filmOf(n);
  shot.film = film;
  shot.box.querySelector(".poster")?.after(film);
  return film;
}
function drop(shot) {
  clearTimeout(shot.wait);
  shot.alone = false;
  shot.box.closest(".clip")?.querySelector(".run")?.setAttribute("aria-pressed", "false");
  if (!shot.film) return;
  shot.film.removeAttribute("src");
  shot.film.load?.();
  shot.film.remove();
  shot.film = null;
}

/* one clip by itself, round and round: under the pointer, in focus, or by its button */
function playAlone(shot) {
  if (shot.alone) return;
  drop(shot);
  shot.alone = true;
  shot.box.closest(".clip")?.querySelector(".run")?.setAttribute("aria-pressed", "true");
  const film = attach(shot);
  if (film?.tagName === "VIDEO") {
    film.addEventListener("ended", () => { // back to the photo for a moment, then again
      film.currentTime = 0;
      shot.wait = setTimeout(() => film.play().catch(() => {}), HOLD);
    });
    film.addEventListener("playing", () => { film.style.opacity = 1; }, { once: true });
    film.play().catch(() => {});
  } else if (film) film.style.opacity = 1;
}
function stopAlone(shot) {
  clearTimeout(shot.wait);
  if (!shot.alone) return;
  drop(shot);
  settleSoon();
}
