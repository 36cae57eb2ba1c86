// Pictures of the scene as it stands: background, objects and shadows as layers, and the photo alone until they are there.

import { picture } from "./api.js";

export function makePictures(editor, changed) {
  let pictures = null,
    asked = null,
    photo = null,
    paint = null;
  picture("/api/photo")
    .then(async (source) => {
      const image = new Image();
      image.src = source;
      await image.decode();
      photo = image;
      changed();
    })
    .catch(() => {});
  async function fetched(key) {
    asked = key;
    let data;
    try {
      data = await editor.request("GET", `/api/picture/${key}`);
    } catch {
      asked = null;
      return;
    }
    const found = await loadPictures({ ...data, shadows: [] });
    if (asked !== key) return;
    const run = editor.player.own,
      rests = new Map(run.motion.bodies.map((body) => [body.name, [body.x[0], body.y[0], body.a[0]]]));
    const names = data.names || run.names;
    // a photo shows an object where it begins, unless it is put elsewhere; without one it is drawn where it was
    const flat = !editor.state.scene?.image;
    pictures = { key, data, found, names, rests, flat, cast: pictures?.cast };
    prepare();
    shaded(editor.player.own);
  }
  // shadows are those of one whole motion; what slides under its object is the same in any, and what rests as it did then keeps its own
  async function shaded(run) {
    if (!pictures || !run?.data.done || pictures.cast?.motion === run.data.key) return;
    const mine = pictures;
    let found;
    try {
      found = await editor.request("GET", `/api/picture/${mine.key}?motion=${run.data.key}`);
    } catch {
      return;
    }
    const images = await Promise.all(
      found.shadows.map((row) =>
        Promise.all(
          row.keys.map(async ({ src }) => {
            if (!src) return null;
            const image = new Image();
            image.src = src;
            await image.decode();
            return image;
          }),
        ),
      ),
    );
    if (pictures !== mine || editor.player.own?.data.key !== run.data.key) return;
    const starts = new Map(run.motion.bodies.map((body) => [body.name, [body.x[0], body.y[0]]]));
    mine.cast = { rows: found.shadows, images, names: run.names, motion: run.data.key, starts };
    prepare();
  }
  function resting({ x, y }, start) {
    if (!start) return false;
    const last = x.length - 1;
    return [0, last >> 1, last].every((k) => Math.hypot(x[k] - start[0], y[k] - start[1]) < 2);
  }
  editor.on("whole", shaded);
  // sprites and shadows by the names of their bodies -> those of the run that is shown
  function prepare() {
    const { run } = editor.player;
    paint = null;
    if (!pictures || !run) {
      changed();
      return;
    }
    const { data, found, names, rests, flat } = pictures,
      rows = [],
      images = { background: found.background, sprites: [], shadows: [], balls: [] };
    data.sprites.forEach((row, k) => {
      const name = names[row.body],
        body = run.index.get(name);
      if (body === undefined) return;
      rows.push({ ...row, body, rest: run.data.bodies[body].rest || (flat ? rests.get(name) : undefined) });
      images.sprites.push(found.sprites[k]);
      images.balls.push(found.balls[k]);
    });
    images.backdrop = found.backdrop ||= document.createElement("canvas");
    const shadows = [],
      cast = pictures.cast;
    cast?.rows.forEach((row, k) => {
      const body = run.index.get(cast.names[row.body]),
        known = cast.motion === run.data.key;
      if (body === undefined || !(known || row.slides || resting(run.motion.bodies[body], cast.starts.get(cast.names[row.body])))) return;
      shadows.push({ ...row, body, keys: known ? row.keys : row.keys.slice(0, 1) });
      images.shadows.push(known ? cast.images[k] : cast.images[k].slice(0, 1));
    });
    const frames = Array.from(run.motion.times.keys());
    paint = makeScene({ ...run.data, frames, background: data.background, sprites: rows, shadows }, run.motion, images);
    changed();
  }
  editor.on("state", ({ state }) => {
    if (state.picture && state.picture !== asked) fetched(state.picture);
  });
  editor.on("motion", prepare);
  return {
    get photo() {
      return photo;
    },
    // whether what is shown is the scene's picture, and no older one
    get whole() {
      return Boolean(paint) && pictures.key === editor.state?.picture;
    },
    draw(context, now, size, shadows) {
      if (editor.tool?.name === "mask" && photo && !pictures?.flat) context.drawImage(photo, -0.5, -0.5, ...size);
      else if (paint) {
        paint(context, now, shadows);
        document.body.dataset.picture = pictures.key;
      } else if (photo) context.drawImage(photo, -0.5, -0.5, ...size);
    },
  };
}
