// Answers of raters <-> the browser's storage, so that a closed page can continue.
const data = JSON.parse(document.getElementById("data").textContent);
const part = name => document.querySelector(`[data-part=${name}]`);
const NAME = `physgen-study-${data.study}`;
let keeps = true; // whether this browser keeps anything for this page
let book = { current: null, raters: {} }; // the current rater, and the answers of each

function readBook() {
  try {
    const found = JSON.parse(localStorage.getItem(NAME) ?? "null");
    if (found && typeof found.raters === "object") book = { current: found.current ?? null, raters: found.raters ?? {} };
    localStorage.setItem(`${NAME}-try`, "1");
    localStorage.removeItem(`${NAME}-try`);
  } catch {
    keeps = false;
  }
}

function writeBook() {
  if (!keeps) return;
  try {
    localStorage.setItem(NAME, JSON.stringify(book));
  } catch {
    keeps = false;
  }
  part("unkept").hidden = keeps;
}

const own = () => book.raters[book.current];
const whole = name => data.questions.every(({ key }) => own().answers[name]?.[key]);
const rated = () => own().order.filter(whole).length;

/* a rater begins, or returns */
function enter(rater) {
  const called = Object.keys(book.raters).find(name => name.toLowerCase() === rater.toLowerCase()) ?? rater;
  book.raters[called] ??= { rater, session: digits(), started: new Date().toISOString(), order: shuffled(data.clips.map(clip => clip.name), `${data.study}/${rater.toLowerCase()}`), at: 0, answers: {}, left: [] };
  book.current = called;
  writeBook();
}

const digits = () => [...crypto.getRandomValues(new Uint8Array(8))].map(b => b.toString(16).padStart(2, "0")).join("");
