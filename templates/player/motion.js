// The page's data -> where everything is at any time, and which moment each frame of the clip shows.

const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

// differences in steps -> values; the editor has values as they are
function summed(codes, step) {
  if (ArrayBuffer.isView(codes)) return codes;
  const values = new Float64Array(codes.length);
  let sum = 0;
  codes.forEach((code, k) => { values[k] = (sum += code) * step; });
  return values;
}

function readMotion(data) {
  const step = data.steps || {};
  const times = summed(data.times, step.time);
  const kinds = { x: "place", y: "place", a: "angle", vx: "speed", vy: "speed", w: "spin" };
  const bodies = data.bodies.map((body) => {
    const columns = Object.entries(kinds).map(([name, kind]) => [name, summed(body[name], step[kind])]);
    const q = body.q && body.q.map((codes) => summed(codes, step.turn));
    return { ...body, ...Object.fromEntries(columns), q };
  });
  const last = times.length - 1;

  // the sample before a time, and the part of the way from it to the next
  function locate(time) {
    if (last < 1 || time <= times[0]) return { sample: 0, part: 0 };
    if (time >= times[last]) return { sample: last - 1, part: 1 };
    let low = 0, high = last;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (times[middle] <= time) low = middle; else high = middle;
    }
    return { sample: low, part: (time - times[low]) / (times[high] - times[low]) };
  }

  const mix = (column, { sample, part }) =>
    part === 0 ? column[sample] : column[sample] + part * (column[sample + 1] - column[sample]);

  return {
    times, bodies, locate, mix,
    end: times[last],
    pose(body, where) {
      return { x: mix(body.x, where), y: mix(body.y, where), a: mix(body.a, where) };
    },
  };
}

// Motion runs once; the clip may show it slowly, backward, or there and back. c: seconds of the clip.
function readClip(data, motion) {
  const shown = data.frames.map((sample) => motion.times[sample]);
  const count = shown.length, fps = data.clip.fps, order = data.clip.order;
  const frames = order === "there-and-back" ? 2 * count - 1 : count;
  const hold = data.clip.hold ?? 0; // frames of the photo before the motion
  const pace = count > 1 ? ((shown[count - 1] - shown[0]) * fps) / (count - 1) : 1;

  const folded = (k) => (order === "backward" ? count - 1 - k : k > count - 1 ? 2 * (count - 1) - k : k);
  function frameAt(time) { // a fraction of frames
    if (count < 2) return 0;
    let k = clamp(Math.floor(((time - shown[0]) / (shown[count - 1] - shown[0])) * (count - 1)), 0, count - 2);
    while (k > 0 && shown[k] > time) k -= 1;
    while (k < count - 2 && shown[k + 1] <= time) k += 1;
    return k + clamp((time - shown[k]) / (shown[k + 1] - shown[k]), 0, 1);
  }
  return {
    fps, frames: frames + hold, count, shown,
    pace, // seconds of motion that a second of the clip shows
    length: (frames + hold) / fps,
    timeAt(c) {
      const at = folded(clamp(c * fps - hold, 0, frames - 1)), k = Math.min(Math.floor(at), Math.max(count - 2, 0));
      return count < 2 ? shown[0] : shown[k] + (at - k) * (shown[k + 1] - shown[k]);
    },
    clipAt: (time) => (folded(frameAt(time)) + hold) / fps,
    frameAt,
  };
}
