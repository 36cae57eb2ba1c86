// A clip's picture: its poster; at a time, a frame of its strip; or its film. Nothing is loaded before it is wanted.
const still = matchMedia("(prefers-reduced-motion: reduce)");
const shots = new Map(); // box -> shot
const strips = new Map(); // number of a clip -> image
const MOST_FILMS = 36; // that play at once; the others run through their strips
const WAIT = 90; // ms that a pointer must stay

const watcher = new IntersectionObserver(entries => {
  for (const { target, isIntersecting } of entries) {
    const shot = shots.get(target);
    if (!shot) continue;
    shot.seen = isIntersecting;
    if (isIntersecting) shot.first?.(shot);
    if (isIntersecting) shot.first = null;
    if (isIntersecting) show(shot); else if (!shot.alone) drop(shot);
  }
}, { rootMargin: "150px" });

function makeShot(box, n, first = null) { // `first` is called when it is seen for the first time
  const shot = { box, n, first, clip: clips[n], seen: false, canvas: null, film: null, alone: false, wait: 0 };
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

function stripOf(n) {
  if (!strips.has(n)) {
    const image = new Image();
    image.src = clips[n].strip;
    strips.set(n, image);
  }
  return strips.get(n);
}

const filmOf = n => clips[n].film;

/* the frame of the strip that is nearest to a time, s; the poster without one */
function show(shot, time = state.time) {
  const { clip, n, box } = shot;
  if (time === null || !clip.strip) {
    shot.canvas?.remove();
    shot.canvas = null;
    return;
  }
  const image = stripOf(n);
  if (!image.complete) {
    image.addEventListener("load", () => shot.seen && show(shot), { once: true });
    return;
  }
  if (!image.naturalWidth) return;
  const wide = image.naturalWidth / clip.across, high = image.naturalHeight / Math.ceil(clip.shown / clip.across);
  const end = lastOf(clip);
  const k = end > 0 ? Math.round(Math.min(time / end, 1) * (clip.shown - 1)) : 0;
  if (!shot.canvas) {
    shot.canvas = Object.assign(document.createElement("canvas"), { width: wide, height: high, className: "strip" });
    box.querySelector(".poster")?.after(shot.canvas);
  }
  shot.canvas.dataset.frame = k;
  shot.canvas.getContext("2d").drawImage(image, (k % clip.across) * wide, Math.floor(k / clip.across) * high, wide, high, 0, 0, wide, high);
}

/* the film of a shot, above its strip; unseen until it has a frame to show */
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
  (shot.canvas ?? shot.box.querySelector(".poster"))?.after(film);
  return film;
}
function drop(shot) {
  clearTimeout(shot.wait);
  clearInterval(shot.ticks);
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
    film.loop = true;
    film.addEventListener("playing", () => { film.style.opacity = 1; }, { once: true });
    film.play().catch(() => {});
  } else if (film) film.style.opacity = 1;
  else if (shot.clip.strip) {
    const began = performance.now(), whole = lastOf(shot.clip) + 1 / shot.clip.fps;
    const step = () => show(shot, ((performance.now() - began) / 1000) % whole);
    step();
    shot.ticks = setInterval(step, Math.max((1000 * whole) / shot.clip.shown, 30));
  }
}
function stopAlone(shot) {
  clearTimeout(shot.wait);
  if (!shot.alone) return;
  drop(shot);
  show(shot);
}
