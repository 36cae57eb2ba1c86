// The table of scores: sorted by a click on a head, and clips of every row in its order.
const part = name => document.querySelector(`[data-part=${name}]`);
const all = (what, within = document) => [...within.querySelectorAll(what)];
const standing = part("standing"), body = standing.tBodies[0], heads = [...standing.tHead.rows[0].cells];
const collate = new Intl.Collator(undefined, { numeric: true, sensitivity: "base" });

function valueOf(line, k) {
  const text = line.cells[k].dataset.value;
  return k === 0 ? text : text === "" ? null : Number(text);
}

function sortBy(k, way) {
  const sign = way === "descending" ? -1 : 1;
  const lines = [...body.rows].sort((a, b) => {
    const [one, two] = [valueOf(a, k), valueOf(b, k)];
    if (one === null || two === null) return (one === null) - (two === null); // without a value: last, either way
    return sign * (k === 0 ? collate.compare(one, two) : one - two) || a.dataset.method - b.dataset.method;
  });
  body.append(...lines);
  heads.forEach((head, n) => (n === k ? head.setAttribute("aria-sort", way) : head.removeAttribute("aria-sort")));
  const place = lines.map(line => line.dataset.method);
  for (const cells of all(".cells")) cells.append(...all(".clip[data-method]", cells).sort((a, b) => place.indexOf(a.dataset.method) - place.indexOf(b.dataset.method)));
}

heads.forEach((head, k) => {
  const button = document.createElement("button");
  button.type = "button";
  button.append(...head.childNodes);
  head.append(button);
  const first = k === 0 || head.dataset.better === "low" ? "ascending" : "descending";
  button.addEventListener("click", () => {
    const now = head.getAttribute("aria-sort");
    sortBy(k, now === null ? first : now === "ascending" ? "descending" : "ascending");
  });
});
