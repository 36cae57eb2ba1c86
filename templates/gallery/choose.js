// State and clips -> which are shown, in which order.
const plain = text => text.normalize("NFKD").replace(/\p{M}/gu, "").toLowerCase();
const texts = []; // of each clip what is searched, once it was asked for
const textOf = n => (texts[n] ??= plain([clips[n].name, clips[n].title, clips[n].sentence, clips[n].variant ?? "", clips[n].where, ...clips[n].labels, ...clips[n].notes].join("\n")));
const textsOf = keys.map(key => new Map(key.values.map((value, k) => [value, key.texts[k]])));
const number = new Intl.Collator(undefined, { numeric: true, sensitivity: "base" });

/* the values of an axis or of an order, one a clip: of a key, or of what every clip has */
const OWN = { name: clip => clip.name, scene: clip => clip.scene, variant: clip => clip.variant ?? "", time: clip => clip.time, objects: clip => (clip.made ? clip.objects : null), duration: clip => (clip.made ? clip.frames / clip.fps : null) };
function valuesOf(path) {
  const at = keys.findIndex(key => key.path === path);
  return at < 0 ? clips.map(OWN[path.slice(1)] ?? (() => null)) : clips.map(clip => clip.values[at]);
}

function fits(n) {
  const clip = clips[n];
  const outcome = { failed: clip.failed, made: !clip.failed, warned: clip.warned };
  return words.every(word => textOf(n).includes(word))
    && (!state.is.size || [...state.is].some(name => outcome[name]))
    && (!state.label.size || clip.labels.some(label => state.label.has(label)))
    && keys.every((key, k) => {
      const value = clip.values[k], chosen = state.picks.get(key.path), range = state.ranges.get(key.path);
      return (!chosen?.size || (value !== null && chosen.has(textsOf[k].get(value))))
        && (!range || (value !== null && value >= range[0] && value <= range[1]));
    });
}

let words = [];
function chosen() {
  words = plain(state.q).split(/\s+/).filter(Boolean);
  const found = [...clips.keys()].filter(fits);
  if (!state.sort) return state.desc ? found.reverse() : found;
  const values = valuesOf(state.sort), way = state.desc ? -1 : 1;
  const compare = (a, b) => {
    const [one, two] = [values[a], values[b]];
    if (one === null || two === null) return (one === null) - (two === null); // without a value: last, either way
    return way * (typeof one === "number" && typeof two === "number" ? one - two : number.compare(one, two)) || a - b;
  };
  return found.sort(compare);
}
