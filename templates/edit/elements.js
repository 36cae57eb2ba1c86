// Elements of the page: made in one line, and found by the name of their part.

const SVG = "http://www.w3.org/2000/svg";

// "p.wrong.wide" is a p of two classes; attributes as they are, true and false as present and absent; `on` maps listeners
export function element(what, { on = {}, ...attributes } = {}, ...children) {
  const [name, ...classes] = what.split("."),
    made = document.createElement(name);
  if (classes.length) made.classList.add(...classes);
  for (const [key, value] of Object.entries(attributes))
    if (key.startsWith("aria-") && value != null) made.setAttribute(key, value);
    else if (value === true) made.setAttribute(key, "");
    else if (value !== false && value != null) made.setAttribute(key, value);
  for (const [kind, listener] of Object.entries(on)) made.addEventListener(kind, listener);
  made.append(...children.filter((child) => child != null && child !== false));
  return made;
}

export function icon(path) {
  const made = document.createElementNS(SVG, "svg"),
    line = document.createElementNS(SVG, "path");
  made.setAttribute("viewBox", "0 0 24 24");
  made.setAttribute("aria-hidden", "true");
  line.setAttribute("d", path);
  made.append(line);
  return made;
}

export const part = (name, root = document) => root.querySelector(`[data-part="${name}"]`);

export const button = (words, run, attributes = {}) => element("button", { type: "button", class: "act", ...attributes, on: { click: run } }, words);

export const isolated = (text) => element("bdi", { dir: "auto" }, text);
