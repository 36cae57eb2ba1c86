// The pixels of one object while they are painted: a mask of the photo's size, its crisp border as a path, its tint.

// The middle of pixel (i, j) is the point (i, j).
export function makeCover(width, height) {
  const cells = new Uint8Array(width * height), canvas = document.createElement("canvas");
  let box = null, border = null, tint = null, left = 0, top = 0;

  function stale(x0, y0, x1, y1) {
    border = tint = null;
    box = box ? [Math.min(box[0], x0), Math.min(box[1], y0), Math.max(box[2], x1), Math.max(box[3], y1)] : [x0, y0, x1, y1];
  }

  // row by row, whole runs where two neighbours differ
  function traced() {
    const path = new Path2D();
    if (!box) return path;
    const at = (x, y) => (x < 0 || y < 0 || x >= width || y >= height ? 0 : cells[y * width + x]);
    for (const across of [true, false]) {
      const [u0, v0, u1, v1] = across ? box : [box[1], box[0], box[3], box[2]];
      for (let v = v0; v <= v1 + 1; v += 1) {
        let from = null;
        for (let u = u0; u <= u1 + 1; u += 1) {
          const edge = u <= u1 && (across ? at(u, v) !== at(u, v - 1) : at(v, u) !== at(v - 1, u));
          if (edge && from === null) from = u;
          if (!edge && from !== null) {
            const ends = [[from - 0.5, v - 0.5], [u - 0.5, v - 0.5]].map(([a, b]) => (across ? [a, b] : [b, a]));
            path.moveTo(...ends[0]);
            path.lineTo(...ends[1]);
            from = null;
          }
        }
      }
    }
    return path;
  }

  function tinted([r, g, b, a]) {
    if (!box) return null;
    [left, top] = box;
    canvas.width = box[2] - left + 1;
    canvas.height = box[3] - top + 1;
    const context = canvas.getContext("2d"), image = context.createImageData(canvas.width, canvas.height);
    for (let y = 0; y < canvas.height; y += 1) for (let x = 0; x < canvas.width; x += 1) {
      if (cells[(top + y) * width + left + x]) image.data.set([r, g, b, a], 4 * (y * canvas.width + x));
    }
    context.putImageData(image, 0, 0);
    return canvas;
  }

  return {
    width, height,
    get area() { return cells.reduce((sum, cell) => sum + cell, 0); },
    has: (x, y) => Boolean(cells[Math.round(y) * width + Math.round(x)]),
    // from a grey picture of the photo's size
    read(image) {
      const flat = document.createElement("canvas");
      [flat.width, flat.height] = [width, height];
      const context = flat.getContext("2d", { willReadFrequently: true });
      context.drawImage(image, 0, 0, width, height);
      const { data } = context.getImageData(0, 0, width, height);
      box = null;
      border = tint = null;
      for (let k = 0; k < cells.length; k += 1) {
        cells[k] = data[4 * k] >= 128 ? 1 : 0;
        if (cells[k]) { const x = k % width, y = (k - x) / width; stale(x, y, x, y); }
      }
    },
    // pixels whose middle is within `radius` of the line between two points
    stroke([ax, ay], [bx, by], radius, value) {
      const x0 = Math.max(0, Math.ceil(Math.min(ax, bx) - radius)), x1 = Math.min(width - 1, Math.floor(Math.max(ax, bx) + radius));
      const y0 = Math.max(0, Math.ceil(Math.min(ay, by) - radius)), y1 = Math.min(height - 1, Math.floor(Math.max(ay, by) + radius));
      if (x0 > x1 || y0 > y1) return;
      const dx = bx - ax, dy = by - ay, long = dx * dx + dy * dy;
      for (let y = y0; y <= y1; y += 1) for (let x = x0; x <= x1; x += 1) {
        const part = long ? Math.min(Math.max(((x - ax) * dx + (y - ay) * dy) / long, 0), 1) : 0;
        if (Math.hypot(x - ax - part * dx, y - ay - part * dy) <= radius) cells[y * width + x] = value;
      }
      stale(x0, y0, x1, y1);
    },
    draw(context, pen, colour, edge) {
      tint ??= tinted(colour);
      border ??= traced();
      if (!tint) return;
      context.imageSmoothingEnabled = false;
      context.drawImage(tint, left - 0.5, top - 0.5);
      context.imageSmoothingEnabled = true;
      pen.stroke(border, edge, 1.3);
    },
  };
}
