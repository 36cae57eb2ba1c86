// A sweep by two of its keys: one row and one column a value, and in each cell the clips that have both.
const sheet = part("sheet");
const SINGLY = 24, BINS = 10; // more numbers than that make ranges
const WORDS = 60; // words of an axis, at most

const AXES = [
  ...keys.map((key, k) => ({ path: key.path, name: key.name, unit: key.unit, follows: key.follows, numeric: key.numeric, count: new Set(key.texts).size, k })),
  ...[["variant", "variant"], ["scene", "scene"]].map(([own, name]) => ({ path: `=${own}`, name, unit: "", follows: false, numeric: false, count: new Set(clips.map(OWN[own])).size, k: -1 })),
].filter(axis => axis.count > 1 && (axis.numeric || axis.count <= WORDS));

function axes() {
  const named = path => AXES.find(axis => axis.path === path);
  const x = named(state.x) ?? AXES[0];
  const y = state.y === "-" ? null : named(state.y) ?? AXES.find(axis => !axis.follows && axis !== x) ?? null;
  return [x, y === x ? null : y];
}

/* an axis and clips -> its places in order, each with its text, and each clip's place */
function places(axis, shown) {
  if (!axis) return { texts: [""], of: new Map(shown.map(n => [n, 0])) };
  const values = valuesOf(axis.path), have = shown.filter(n => values[n] !== null);
  const numbers = [...new Set(have.map(n => values[n]))];
  if (axis.numeric && numbers.length > SINGLY) {
    const low = Math.min(...numbers), step = (Math.max(...numbers) - low) / BINS;
    const at = n => Math.min(Math.floor((values[n] - low) / step), BINS - 1);
    const edge = k => (low + k * step).toLocaleString("en", { maximumSignificantDigits: 3 });
    return { texts: Array.from({ length: BINS }, (_, k) => `${edge(k)} to ${edge(k + 1)}`), of: new Map(have.map(n => [n, at(n)])) };
  }
  const text = n => (axis.k < 0 ? values[n] || "as it is" : textsOf[axis.k].get(values[n]));
  have.sort((a, b) => (axis.numeric ? values[a] - values[b] : number.compare(text(a), text(b))));
  const found = [...new Set(have.map(text))];
  return { texts: found, of: new Map(have.map(n => [n, found.indexOf(text(n))])) };
}

const make = (tag, { text, ...rest } = {}, children = []) => {
  const element = Object.assign(document.createElement(tag), rest);
  if (text !== undefined) element.textContent = text;
  element.append(...children);
  return element;
};

function drawSheet(shown) {
  for (const box of all(".shot", sheet)) forgetShot(box);
  sheet.replaceChildren();
  const [x, y] = axes();
  if (!x || !shown.length) return;
  const has = axis => { const values = axis && valuesOf(axis.path); return n => !values || values[n] !== null; };
  const both = shown.filter(has(x)).filter(has(y));
  const across = places(x, both), down = places(y, both);
  const cells = new Map();
  for (const n of both) {
    const at = `${down.of.get(n)},${across.of.get(n)}`;
    cells.set(at, [...(cells.get(at) ?? []), n]);
  }
  const name = axis => [make("b", { text: axis.name }), axis.unit ? ` ${axis.unit}` : ""];
  const head = make("thead", {}, [
    make("tr", {}, [make("td", { className: "corner" }), make("th", { className: "axis", colSpan: across.texts.length, scope: "colgroup" }, [...name(x), " →"])]),
    make("tr", {}, [make("td", { className: "corner" }, y ? [...name(y), "\u00a0↓"] : []), ...across.texts.map(text => make("th", { scope: "col" }, [make("bdi", { text })]))]),
  ]);
  const body = make("tbody", {}, down.texts.map((text, j) => make("tr", {}, [
    make("th", { scope: "row" }, [make("bdi", { text })]),
    ...across.texts.map((_, i) => make("td", {}, cells.has(`${j},${i}`) ? [cell(cells.get(`${j},${i}`))] : [])),
  ])));
  const placed = [...cells.values()].flat().length, most = Math.max(0, ...[...cells.values()].map(cell => cell.length));
  const others = AXES.filter(axis => axis !== x && axis !== y && !axis.follows && axis.k >= 0).map(axis => axis.name);
  const notes = [
    placed < shown.length ? `${shown.length - placed} of ${shown.length} clips have no such value and are not here.` : "",
    most > 1 ? `Some cells hold several clips${others.length ? `, since ${others.slice(0, 3).join(", ")} differ${others.length === 1 ? "s" : ""}, too` : ""}; a cell opens to show them.` : "",
  ].filter(Boolean).join(" ");
  const caption = make("caption", notes ? { text: notes } : { className: "unseen", text: `Clips by ${x.name}${y ? ` and ${y.name}` : ""}` });
  sheet.append(make("table", {}, [caption, head, body]));
  sheet.style.setProperty("--columns", across.texts.length);
  sheet.classList.toggle("dense", across.texts.length > 8);
}

function cell(found) {
  const n = found[0], clip = clips[n], several = found.length > 1;
  const link = clip.href && !several && !clip.failed;
  const values = keys.map((key, k) => (clip.values[k] === null ? "" : `${key.name} ${textsOf[k].get(clip.values[k])}`)).filter(Boolean);
  const label = several ? `${found.length} clips, the first: ${clip.name}` : [clip.name, ...values].join(", ");
  const box = clip.poster ? make("div", { className: "shot" }) : null;
  const inside = clip.failed && !clip.poster
    ? make("div", { className: "why" }, [make("p", { className: "bad", text: "Failed" }), make("p", { text: clip.why })])
    : box ?? make("div", { className: "shot none" }, [make("span", { text: "no picture" })]);
  const element = make(link ? "a" : "button", link ? { href: withWayBack(clip.href), className: "cell" } : { type: "button", className: "cell" }, [inside]);
  element.setAttribute("aria-label", clip.failed ? `${label}: failed` : clip.warned ? `${label}: with warnings` : label);
  if (clip.warned) inside.append(make("span", { className: "badge", text: "warning" }));
  if (several) element.append(make("span", { className: "more", text: `+${found.length - 1}` }));
  if (!link) element.addEventListener("click", () => look(found));
  if (inside === box) makeShot(box, n, () => box.prepend(...[poster(n)].filter(Boolean))); // its picture when it is seen
  return element;
}

function poster(n) {
  const image = all(".poster", cards[n])[0]?.cloneNode();
  if (image) image.alt = "";
  return image;
}
