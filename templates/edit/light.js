// The light as a small sphere on the photo: drag it to where the light comes from.

import { element, part } from "./elements.js";
import { makeRepeated, setting } from "./dragging.js";

const SIZE = 64,
  TURN = (5 * Math.PI) / 180;

export function start(editor) {
  const canvas = element("canvas", { width: 2 * SIZE, height: 2 * SIZE, "aria-hidden": "true" });
  const ball = element("button.light", { type: "button", title: "The photo's light: drag to where it comes from", hidden: true }, canvas);
  const repeated = makeRepeated(editor);
  let dragged = null;
  part("stage").append(ball);
  const light = () => editor.state?.scene?.light;
  const now = () => unit(dragged || light()?.direction || [0, 0, 1]);
  const unit = (v) => {
    const long = Math.hypot(...v) || 1;
    return v.map((x) => x / long);
  };

  // a white ball under that light, as bright as the scene's
  function draw() {
    const context = canvas.getContext("2d"),
      picture = context.createImageData(2 * SIZE, 2 * SIZE),
      [lx, ly, lz] = now();
    const { intensity = 0.8, ambient = 0.4 } = light() || {},
      most = intensity + ambient || 1;
    for (let row = 0; row < 2 * SIZE; row += 1)
      for (let column = 0; column < 2 * SIZE; column += 1) {
        const x = (column + 0.5) / SIZE - 1,
          y = (row + 0.5) / SIZE - 1,
          r = x * x + y * y,
          at = 4 * (row * 2 * SIZE + column);
        if (r > 1) continue;
        const shade = (ambient + intensity * Math.max(0, x * lx + y * ly + Math.sqrt(1 - r) * lz)) / most;
        picture.data.set([255 * shade ** 0.45, 250 * shade ** 0.45, 236 * shade ** 0.45, 255], at);
      }
    context.putImageData(picture, 0, 0);
    context.beginPath();
    context.arc(SIZE + 0.86 * SIZE * lx, SIZE + 0.86 * SIZE * ly, 7, 0, 2 * Math.PI);
    context.lineWidth = 4;
    context.strokeStyle = "#c98a00";
    context.setLineDash(lz < 0 ? [4, 4] : []);
    context.stroke();
    const hours = Math.round(((Math.atan2(lx, -ly) * 6) / Math.PI + 12) % 12) || 12;
    ball.setAttribute(
      "aria-label",
      light()
        ? `Light from ${hours} o'clock, ${Math.round((Math.asin(Math.abs(lz)) * 180) / Math.PI)} degrees ${lz < 0 ? "from behind" : "to the front"}; arrow keys turn it`
        : "No light set: press an arrow key or drag to set one",
    );
  }
  const made = (direction) => {
    const value = unit(direction).map((x) => +x.toFixed(3));
    return light() ? setting(editor, ["light", "direction"], value) : [{ set: ["light"], value: { direction: value } }];
  };
  const put = (direction) => {
    editor
      .edit(made(direction), "light turned")
      .catch(() => {})
      .finally(() => {
        dragged = null;
        draw();
      });
  };
  function pointed(event) {
    const box = ball.getBoundingClientRect();
    let x = (2 * (event.clientX - box.left)) / box.width - 1,
      y = (2 * (event.clientY - box.top)) / box.height - 1;
    const r = Math.hypot(x, y);
    if (r > 0.98) {
      x *= 0.98 / r;
      y *= 0.98 / r;
    }
    return [x, y, Math.sqrt(Math.max(0, 1 - x * x - y * y))];
  }
  ball.addEventListener("pointerdown", (event) => {
    ball.setPointerCapture(event.pointerId);
    ball.dataset.held = "true";
    event.preventDefault();
    ball.focus();
  });
  ball.addEventListener("pointermove", (event) => {
    if (ball.dataset.held) {
      dragged = pointed(event);
      draw();
    }
  });
  ball.addEventListener("pointerup", () => {
    delete ball.dataset.held;
    if (dragged) put(dragged);
  });
  ball.addEventListener("pointercancel", () => {
    delete ball.dataset.held;
    dragged = null;
    draw();
  });
  ball.addEventListener("keydown", (event) => {
    const [dx, dy] = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key] || [0, 0];
    if (!dx && !dy) return;
    repeated("light", [dx, dy], ([right, down]) => {
      const [x, y, z] = now(),
        to = [x + right * TURN, y + down * TURN],
        flat = Math.min(to[0] ** 2 + to[1] ** 2, 0.999);
      return { ops: made([...to, Math.sign(z || 1) * Math.sqrt(1 - flat)]), what: "light turned", tag: "light" };
    });
    event.preventDefault();
    event.stopPropagation();
  });
  editor.on("state", () => {
    ball.hidden = !editor.state.scene;
    draw();
  });
}
