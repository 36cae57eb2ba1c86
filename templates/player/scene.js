// Pictures and poses -> the scene on a canvas, as it stands at a time.

function loadPictures(data) {
  const sources = [data.background, ...data.sprites.map((s) => s.src),
    ...data.shadows.flatMap((s) => s.keys.map((key) => key.src)),
    ...data.sprites.flatMap(({ ball }) => (ball ? [ball.skin.src, ball.lit.src, ball.gloss.src] : []))];
  return Promise.all(sources.map((src) => {
    if (!src) return null;
    const image = new Image();
    image.src = src;
    return image.decode().then(() => image);
  })).then((images) => {
    const next = images.values(), take = () => next.next().value;
    const found = {
      background: take(),
      sprites: data.sprites.map(take),
      shadows: data.shadows.map((s) => s.keys.map(take)),
    };
    found.balls = data.sprites.map(({ ball }, k) => ball && makeBall(
      ball, { skin: ball.skin.most, lit: ball.lit.most, gloss: ball.gloss.most }, [found.sprites[k], take(), take(), take()]));
    return found;
  });
}

function makeScene(data, motion, pictures) {
  function put(context, image, [left, top, w, h]) { context.drawImage(image, left, top, w, h); }

  // between two moments at which it is known, a shadow goes where its object goes, and one picture gives way to the other
  function shadow(context, row, images, time, pose) {
    const body = motion.bodies[row.body], first = row.keys[0];
    if (row.slides) {
      const image = images[0];
      if (!image) return;
      const [left, top, w, h] = first.box, [x, y] = body.rest || [body.x[0], body.y[0]]; // as the photo shows it
      const far = 1 + (row.lean || 0); // away from a lamp that is near
      put(context, image, [left + far * (pose.x - x), top + far * (pose.y - y), w, h]);
      return;
    }
    const samples = row.keys.map((key) => data.frames[key.sample]);
    let k = 0;
    while (k + 2 < row.keys.length && motion.times[samples[k + 1]] <= time) k += 1;
    const ends = [k, Math.min(k + 1, row.keys.length - 1)];
    const [t0, t1] = ends.map((end) => motion.times[samples[end]]);
    const part = t1 > t0 ? clamp((time - t0) / (t1 - t0), 0, 1) : 0;
    const straight = (column) => column[samples[ends[0]]] + part * (column[samples[ends[1]]] - column[samples[ends[0]]]);
    const known = ends.filter((end) => images[end]);
    if (!known.length) return;
    // where it is known at one of the two moments only, it goes from there
    const along = (column) => (known.length < ends.length ? column[samples[known[0]]] : straight(column));
    const dx = pose.x - along(body.x), dy = data.top ? pose.y - along(body.y) : 0;
    const [a, b] = [known[0], known[known.length - 1]].map((end) => row.keys[end].at);
    const at = [a[0] + part * (b[0] - a[0]) + dx, a[1] + part * (b[1] - a[1]) + dy];
    ends.forEach((end, n) => {
      const strength = n ? part : 1 - part;
      if (!images[end] || strength <= 0 || (n && ends[0] === ends[1])) return;
      const [left, top, w, h] = row.keys[end].box, middle = row.keys[end].at;
      context.globalAlpha = ends[0] === ends[1] ? 1 : strength;
      put(context, images[end], [left + at[0] - middle[0], top + at[1] - middle[1], w, h]);
    });
    context.globalAlpha = 1;
  }

  function sprite(context, row, image, pose, ball, where) {
    const body = motion.bodies[row.body], [left, top, w, h] = row.box;
    const [x, y, a] = row.rest || body.rest || [body.x[0], body.y[0], body.a[0]]; // as the picture shows it
    const moved = ball && (pose.x !== x || pose.y !== y || pose.a !== a);
    const turn = row.turns && !ball && !(data.top && body.ball) ? pose.a - a : 0;
    if (moved) image = ball(turnOf(body, where, motion.mix, a));
    context.save();
    context.translate(pose.x, pose.y + row.face); // a front turns about its own middle
    if (turn) context.rotate(turn);
    put(context, image, [left - x, top - y - row.face, w, h]);
    context.restore();
  }

  // the background as large as it is shown: to copy it is far quicker than to scale it for every frame
  const backdrop = (pictures.backdrop ||= document.createElement("canvas"));
  function behind(context) {
    const { width: wide, height: tall } = context.canvas;
    if (backdrop.width !== wide || backdrop.height !== tall) {
      backdrop.width = wide;
      backdrop.height = tall;
      const scaled = backdrop.getContext("2d");
      scaled.imageSmoothingQuality = "high";
      scaled.drawImage(pictures.background, 0, 0, wide, tall);
    }
    context.save();
    context.resetTransform();
    context.drawImage(backdrop, 0, 0);
    context.restore();
  }

  // `hidden`: bodies that are left out
  return (context, { time, poses, where, hidden }, shadows) => {
    behind(context);
    const shown = ({ body }) => !hidden?.has(body);
    if (shadows) data.shadows.forEach((row, k) => shown(row) && shadow(context, row, pictures.shadows[k], time, poses[row.body]));
    data.sprites.forEach((row, k) => shown(row) && sprite(context, row, pictures.sprites[k], poses[row.body], pictures.balls[k], where));
  };
}
