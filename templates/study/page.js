// The page's screens tied together: begin, rate one clip after the other, save.
const sets = [...document.querySelectorAll("fieldset")];
let here = 0; // the statement that keys answer

function go(screen) {
  for (const section of document.querySelectorAll("[data-screen]")) section.hidden = section.dataset.screen !== screen;
  if (screen !== "rate") film.pause();
  scrollTo(0, 0);
}

function point(k) {
  here = k;
  sets.forEach((set, n) => set.classList.toggle("here", n === k));
}

function show() {
  const { order, at, answers } = own(), name = order[at];
  go("rate");
  part("number").textContent = `Video ${at + 1} of ${order.length}`;
  part("progress").value = rated();
  for (const set of sets) for (const box of set.querySelectorAll("input")) box.checked = answers[name]?.[set.dataset.question] === Number(box.value);
  part("missing").textContent = "";
  part("back").hidden = at === 0;
  stage(name);
  point(Math.max(sets.findIndex(set => !answers[name]?.[set.dataset.question]), 0));
  ready();
  part("number").focus({ preventScroll: true });
}

const name = () => own().order[own().at];
const ready = () => part("next").setAttribute("aria-disabled", String(!whole(name())));

function answer(set, value) {
  const mine = own();
  mine.answers[name()] = { ...mine.answers[name()], [set.dataset.question]: value, seconds: seconds() };
  mine.left = mine.left.filter(other => other !== name());
  set.querySelector(`[value="${value}"]`).checked = true;
  part("progress").value = rated();
  part("missing").textContent = "";
  ready();
  writeBook();
}

function move(step) {
  const mine = own();
  if (mine.answers[name()]) mine.answers[name()].seconds = seconds();
  mine.at = Math.max(mine.at + step, 0);
  if (mine.at < mine.order.length) { writeBook(); show(); } else { mine.at = mine.order.length - 1; mine.ended = true; writeBook(); finish(); }
}

function next() {
  if (whole(name())) move(1);
  else {
    part("missing").textContent = "Answer both statements first, or leave the video out.";
    point(sets.findIndex(set => !own().answers[name()]?.[set.dataset.question]));
  }
}

function finish() {
  const { order, saved } = own(), count = rated();
  go("done");
  part("done-title").textContent = count === order.length ? "Thank you" : "So far";
  part("sum").textContent = `You have rated ${count} of ${order.length} videos.`;
  part("saved").textContent = saved === count ? "These answers are saved." : "";
  part("text").value = record();
  part("more").textContent = count === order.length ? "Look at answers again" : "Go on rating";
  part("done-title").focus();
}

part("begin").addEventListener("submit", event => {
  event.preventDefault();
  const rater = part("begin").elements.rater.value.trim().replace(/\s+/g, " ").normalize();
  if (!rater) return;
  enter(rater);
  if (own().ended) finish(); else show();
});
part("answer").addEventListener("submit", event => { event.preventDefault(); next(); });
for (const [k, set] of sets.entries()) {
  set.addEventListener("change", event => { answer(set, Number(event.target.value)); point(Math.min(k + 1, sets.length - 1)); });
  set.addEventListener("focusin", () => point(k));
}
part("back").addEventListener("click", () => move(-1));
part("skip").addEventListener("click", () => {
  const mine = own();
  delete mine.answers[name()];
  if (!mine.left.includes(name())) mine.left.push(name());
  move(1);
});
part("stop").addEventListener("click", () => { film.pause(); finish(); });
part("save").addEventListener("click", save);
part("more").addEventListener("click", () => {
  const mine = own(), open = mine.order.findIndex(name => !whole(name) && !mine.left.includes(name));
  mine.ended = false;
  if (open >= 0) mine.at = open; else if (rated() === mine.order.length) mine.at = 0;
  writeBook();
  show();
});
part("other").addEventListener("click", () => { book.current = null; writeBook(); start(); });

addEventListener("keydown", event => {
  const target = event.target, field = target.matches?.("input:not([type=radio]), textarea");
  if (document.querySelector("[data-screen=rate]").hidden || field || event.altKey || event.ctrlKey || event.metaKey) return;
  const control = target.matches?.("button, summary, a"), radio = target.matches?.("input");
  if (/^[1-5]$/.test(event.key)) {
    const last = here;
    answer(sets[here], Number(event.key));
    point(Math.min(last + 1, sets.length - 1));
    if (radio) part("number").focus({ preventScroll: true }); // arrows would change the answer
  } else if (event.key === "Enter" && !control) next();
  else if (event.key === " " && !control && !radio) toggle();
  else if (event.key === "ArrowLeft" && !radio) { if (own().at > 0) move(-1); }
  else if (event.key === "ArrowRight" && !radio) next();
  else if (event.key === "ArrowUp" && !radio) point(Math.max(here - 1, 0));
  else if (event.key === "ArrowDown" && !radio) point(Math.min(here + 1, sets.length - 1));
  else return;
  event.preventDefault();
});
addEventListener("beforeunload", event => { if (!keeps && book.current && own().saved !== rated()) event.preventDefault(); });

function start() {
  go("start");
  part("begin").elements.rater.value = "";
  if (matchMedia("(hover: hover) and (min-width: 641px)").matches) part("begin").elements.rater.focus({ preventScroll: true });
}

readBook();
part("unkept").hidden = keeps;
if (book.current && own()) { if (own().ended) finish(); else show(); } else start();
document.documentElement.dataset.ready = "";
