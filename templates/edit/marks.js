// A scene file's text -> the parts of its lines by kind, and which lines tell of which object. It reads lines, not YAML:
// what stands in quotes over several lines is shown plain.

const TOKEN = /("(?:[^"\\]|\\.)*"|'(?:[^']|'')*')|((?:^|\s)#.*$)|([A-Za-z_*][\w.*\[\]-]*)(?=\s*:(?:\s|$))|([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)(?![\w.-])|(\b(?:true|false|null)\b|~(?=\s*[,}\]]|\s*$))|([{}[\],:]|^\s*-(?=\s))/gi;
const KINDS = ["text", "remark", "key", "number", "word", "sign"];
const LONGEST = 2000; // letters of a line beyond which it is shown plain

// A line -> [[kind or null, letters], ...], which together are the line.
export function parts(line) {
  if (line.length > LONGEST) return [[null, line]];
  const found = [];
  let at = 0;
  for (const match of line.matchAll(TOKEN)) {
    const glued = match[4] !== undefined && /[\w.]/.test(line[match.index - 1] ?? ""); // the 1 of ball-1 is no number
    const before = match[4] !== undefined && /[A-Za-z_]-?$/.test(line.slice(0, match.index));
    if (match[2] !== undefined && quoted(line, match.index)) continue;
    if (glued || before) continue;
    if (match.index > at) found.push([null, line.slice(at, match.index)]);
    found.push([KINDS[match.slice(1).findIndex((group) => group !== undefined)], match[0]]);
    at = match.index + match[0].length;
  }
  if (at < line.length) found.push([null, line.slice(at)]);
  return found;
}

const quoted = (line, at) => (line.slice(0, at).replace(/\\./g, "").match(/"/g) ?? []).length % 2 === 1;

const indent = (line) => line.length - line.trimStart().length;
const bare = (line) => !line.trim() || line.trimStart().startsWith("#");

// -> {name: [first, last]}: the lines, counted from 0, in which each object (or each entry of another section) is written.
export function objectLines(lines, section = "objects") {
  const found = {};
  const begin = lines.findIndex((line) => line.startsWith(section) && /^\s*:/.test(line.slice(section.length)));
  if (begin < 0) return found;
  let deep = null, name = null;
  for (let k = begin + 1; k < lines.length; k += 1) {
    if (bare(lines[k])) continue;
    const far = indent(lines[k]);
    if (far === 0) break;
    deep ??= far;
    const key = far === deep && lines[k].trim().match(/^(?:"([^"]+)"|'([^']+)'|([^\s:#"']+))\s*:(?:\s|$)/);
    if (key) {
      name = key[1] ?? key[2] ?? key[3];
      found[name] = [k, k];
    } else if (name) found[name][1] = k;
  }
  return found;
}

// Two texts -> what changed as one piece: [from, to of the first, from, to of the second], letters.
export function changed(was, is) {
  let head = 0, tail = 0;
  const least = Math.min(was.length, is.length);
  while (head < least && was[head] === is[head]) head += 1;
  while (tail < least - head && was[was.length - 1 - tail] === is[is.length - 1 - tail]) tail += 1;
  return [head, was.length - tail, head, is.length - tail];
}

// Somebody's change put into mine where the two do not touch -> the text, or null where they do.
export function joined(base, mine, theirs) {
  if (base === theirs || mine === theirs) return mine;
  const [a0, a1, b0, b1] = changed(base, mine), [c0, c1, d0, d1] = changed(base, theirs);
  if (c1 < a0) return mine.slice(0, c0) + theirs.slice(d0, d1) + mine.slice(c1);
  if (a1 < c0) return theirs.slice(0, a0) + mine.slice(b0, b1) + theirs.slice(a1);
  return null;
}

// What a text field made of a file's line ends -> the file's own ends where nothing changed, its commonest elsewhere.
export function withEnds(raw, text) {
  if (!raw.includes("\r")) return text;
  const before = raw.split(/(?<=\r\n|\n|\r(?!\n))/), plain = before.map((line) => line.replace(/\r\n?|\n/, "\n"));
  const usual = (raw.match(/\r\n/g) ?? []).length * 2 >= before.length ? "\r\n" : "\n";
  const now = text.split(/(?<=\n)/);
  let head = 0, tail = 0;
  const least = Math.min(plain.length, now.length);
  while (head < least && plain[head] === now[head]) head += 1;
  while (tail < least - head && plain[plain.length - 1 - tail] === now[now.length - 1 - tail]) tail += 1;
  const middle = now.slice(head, now.length - tail).map((line) => line.replace("\n", usual));
  return [...before.slice(0, head), ...middle, ...before.slice(before.length - tail)].join("");
}

export const plainEnds = (text) => text.replace(/\r\n?/g, "\n");
