// A ball's skin, light and gloss -> the ball as it has turned in space: skin turns, light stays.
// As in physgen.render.atlas, a point of the side that the photo does not show has its antipode's colour; but borders of
// paints are not smoothed across the rim.

const RIM = 0.955; // of the radius: beyond it the skin goes on as it is there
const CODE = Uint8ClampedArray.from({ length: 4097 }, (_, k) => {
  const v = k / 4096;
  return 255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055) + 0.5;
});

function codesOf(image) {
  const canvas = document.createElement("canvas");
  canvas.width = image.naturalWidth;
  canvas.height = image.naturalHeight;
  const context = canvas.getContext("2d", { willReadFrequently: true });
  context.drawImage(image, 0, 0);
  return context.getImageData(0, 0, canvas.width, canvas.height);
}

// rows of the turn's matrix from what the picture shows, where the body is turned by `rest`; image axes, +z into the photo
function turnOf(body, where, mix, rest = body.a[0]) {
  if (!body.q) {
    const a = mix(body.a, where) - rest, c = Math.cos(a), s = Math.sin(a);
    return [c, -s, 0, s, c, 0, 0, 0, 1];
  }
  const c = Math.cos(rest - body.a[0]), s = Math.sin(rest - body.a[0]), m = inSpace(body, where, mix);
  return m.map((value, k) => (k % 3 === 0 ? c * value - s * m[k + 1] : k % 3 === 1 ? s * m[k - 1] + c * value : value));
}

function inSpace(body, where, mix) {
  const parts = body.q.map((column) => mix(column, where)), long = Math.hypot(...parts) || 1;
  const [w, x, y, z] = parts.map((part) => part / long);
  return [
    1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
    2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
    2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
  ];
}

function makeBall({ center: [cx, cy], radius }, most, images) {
  const [cut, skinned, shone, glossed] = images.map(codesOf), { width, height } = cut;
  const root = (image, one) => Float32Array.from(image.data, (code) => one * (code / 255) ** 2);
  const skin = root(skinned, most.skin), lit = root(shone, most.lit);
  const gloss = Float32Array.from(glossed.data, (code) => most.gloss * ((code - 128) / 127) * Math.abs((code - 128) / 127));
  const canvas = document.createElement("canvas");
  canvas.width = width;
  canvas.height = height;
  const context = canvas.getContext("2d"), out = context.createImageData(width, height), far = 1 - RIM * RIM;

  // the ball turned by a matrix; `m` has its rows one after the other
  return (m) => {
    for (let row = 0; row < height; row += 1) {
      for (let column = 0; column < width; column += 1) {
        const at = 4 * (row * width + column);
        if (!(out.data[at + 3] = cut.data[at + 3])) continue;
        const u = (column - cx) / radius, v = (row - cy) / radius, z = Math.sqrt(Math.max(1 - u * u - v * v, far));
        // back to where the point was at t = 0: the transposed matrix
        const side = m[2] * u + m[5] * v - m[8] * z > 0 ? -radius : radius;
        const x = clamp(cx + side * (m[0] * u + m[3] * v - m[6] * z), 0, width - 1.001);
        const y = clamp(cy + side * (m[1] * u + m[4] * v - m[7] * z), 0, height - 1.001);
        const x0 = x | 0, y0 = y | 0, fx = x - x0, fy = y - y0, from = 4 * (y0 * width + x0), below = from + 4 * width;
        for (let c = 0; c < 3; c += 1) {
          const top = skin[from + c] + fx * (skin[from + 4 + c] - skin[from + c]);
          const low = skin[below + c] + fx * (skin[below + 4 + c] - skin[below + c]);
          const light = (top + fy * (low - top)) * lit[at + c] + gloss[at + c];
          out.data[at + c] = CODE[light <= 0 ? 0 : light >= 1 ? 4096 : (4096 * light) | 0];
        }
      }
    }
    context.putImageData(out, 0, 0);
    return canvas;
  };
}
