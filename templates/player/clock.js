// Playback time: runs, steps and seeks; listeners are called at each change. c: seconds of the clip.

function makeClock(clip, changed) {
  let c = 0, time = clip.timeAt(0), playing = false, rate = clip.pace, loop = true, before = null;

  function tick(now) {
    if (!playing) return;
    let wrapped = false;
    if (before !== null) {
      c += (Math.min(now - before, 250) / 1000) * (rate / clip.pace);
      if (c >= clip.length) {
        wrapped = true;
        if (loop) c %= clip.length; else { c = clip.length; playing = false; }
      }
    }
    before = now;
    time = clip.timeAt(c);
    changed({ wrapped });
    if (playing) requestAnimationFrame(tick);
  }

  const clock = {
    get time() { return time; },
    get clip() { return c; },
    get playing() { return playing; },
    get rate() { return rate; },
    get loop() { return loop; },
    set rate(value) { rate = value; changed({ paced: true }); },
    set loop(value) { loop = value; changed({}); },
    play() {
      if (playing || clip.frames < 2) return;
      if (c >= clip.length - 0.5 / clip.fps) c = 0;
      playing = true;
      before = null;
      changed({ started: true });
      requestAnimationFrame(tick);
    },
    pause() {
      if (!playing) return;
      playing = false;
      changed({ stopped: true });
    },
    toggle() { if (playing) clock.pause(); else clock.play(); },
    seek(to) {
      time = clamp(to, clip.shown[0], clip.shown[clip.count - 1]);
      c = clip.clipAt(time);
      changed({ sought: true });
    },
    // to the next whole frame of the motion, forward or back
    step(frames) {
      clock.pause();
      const at = clip.frameAt(time);
      const whole = frames > 0 ? Math.floor(at + 1e-6) : Math.ceil(at - 1e-6);
      clock.seek(clip.shown[clamp(whole + frames, 0, clip.count - 1)]);
    },
  };
  return clock;
}

// A film that the page carries -> the address of a file: browsers go to and fro in that, and can save it.
function unpacked(source) {
  const [head, text] = source.split(",");
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return URL.createObjectURL(new Blob([bytes], { type: head.slice(5, head.indexOf(";")) }));
}

// A folder of frames beside the player: the one of its time, as fast as they can be read.
function followFrames(image, folder, clip, clock) {
  let shown = 0, wanted = 0;
  const next = () => {
    if (shown === wanted) return;
    shown = wanted;
    image.src = `${folder}${String(shown).padStart(5, "0")}.png`;
  };
  image.addEventListener("load", next);
  return () => {
    wanted = Math.floor(clamp(clock.clip * clip.fps + 1e-3, 0, clip.frames - 1));
    if (image.complete) next();
  };
}

// The rendered video beside the player, held in step with it.
function followVideo(video, clip, clock) {
  const SLOWEST = 0.0625, FASTEST = 16;
  let wanted = null;

  function seek(c) {
    if (video.seeking) { wanted = c; return; }
    wanted = null;
    const frame = Math.floor(clamp(c * clip.fps + 1e-3, 0, clip.frames - 1));
    video.currentTime = (frame + 0.5) / clip.fps; // the middle of a frame, where no rounding shows its neighbour
  }
  video.addEventListener("seeked", () => { if (wanted !== null) seek(wanted); });

  return ({ wrapped, sought, started, stopped, paced } = {}) => {
    if (video.readyState < 1) return;
    const pace = clock.rate / clip.pace, able = pace >= SLOWEST && pace <= FASTEST;
    if (clock.playing && able) {
      if (video.playbackRate !== pace) video.playbackRate = pace;
      const off = Math.abs(video.currentTime - clock.clip);
      if (wrapped || sought || (off > Math.max(0.1, 2.5 / clip.fps) * Math.max(1, pace) && !video.seeking)) seek(clock.clip);
      if (video.paused && clock.clip < clip.length - 1 / clip.fps) video.play().catch(() => {});
      return;
    }
    if (!video.paused) video.pause();
    if (stopped || sought || paced || started || wrapped || clock.playing) seek(clock.clip);
  };
}
