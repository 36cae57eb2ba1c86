// Numbers in g, px and s -> words, in SI where the scene has a scale.

const PREFIXES = [[1e9, "G"], [1e6, "M"], [1e3, "k"], [1, ""], [1e-3, "m"], [1e-6, "µ"], [1e-9, "n"]];
const METRES = 0.1; // m and m/s from which on lengths and speeds are in metres
const RAISED = "⁰¹²³⁴⁵⁶⁷⁸⁹";

// three digits, thousands set apart, no exponent, a real minus
function digits(value, count = 3) {
  if (!Number.isFinite(value)) return "–";
  if (Math.abs(value) < 1e-9) return "0";
  const places = clamp(count - 1 - Math.floor(Math.log10(Math.abs(value))), 0, 6);
  return value.toLocaleString("en", { minimumFractionDigits: places, maximumFractionDigits: places }).replace("-", "−");
}

// a number and its unit, which may begin with a power of ten
const joined = (value, unit, count = 3) => `${digits(value, count)}${/^10/.test(unit) ? "·" : " "}${unit}`;

function readUnits(data) {
  const meter = data.scale, newton = meter ? 1000 * meter : null;
  const si = {
    length: ["m", meter], speed: ["m/s", meter], energy: ["J", newton && newton * meter],
    impulse: ["N·s", newton], force: ["N", newton], torque: ["N·m", newton && newton * meter],
  };
  const px = {
    length: "px", speed: "px/s", energy: "g·px²/s²", impulse: "g·px/s", force: "g·px/s²", torque: "g·px²/s²",
  };
  // how an axis on which `most` is the largest is labelled: {per, unit}, value / per is what to write
  function axis(kind, most) {
    if (!meter) {
      const power = most >= 1e5 ? 3 * Math.floor(Math.log10(most) / 3) : 0;
      const sign = power ? `10${[...String(power)].map((d) => RAISED[d]).join("")} ` : "";
      return { per: 10 ** power, unit: sign + px[kind] };
    }
    const [name, one] = si[kind], value = most / one;
    const least = kind === "length" || kind === "speed" ? METRES : 1; // 0.5 m, not 500 mm
    const [factor, prefix] = PREFIXES.find(([f]) => value >= f * (f === 1 ? least : 1) * 0.9999) || PREFIXES[PREFIXES.length - 1];
    return { per: one * (value ? factor : 1), unit: (value ? prefix : "") + name };
  }
  function worded(kind, value) {
    const { per, unit } = axis(kind, Math.abs(value));
    return joined(value / per, unit);
  }
  return { axis, worded, both: (kind, value) => (meter ? `${digits(value, 2)} ${px[kind]}` : "") };
}

// the largest of 1, 2, 5, 10, 20 ... that is not above a positive value
function roundBelow(value) {
  const power = 10 ** Math.floor(Math.log10(value) + 1e-12);
  return power * [5, 2, 1].find((k) => k <= (value / power) * (1 + 1e-9));
}

// about `count` round numbers from low to high
function ticksOf(low, high, count) {
  if (!(high > low)) return [low];
  let step = roundBelow((high - low) / count);
  while ((high - low) / step > count + 0.5) step = roundBelow(step * 2.6);
  const ticks = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k += 1) ticks.push(k * step);
  return ticks;
}
