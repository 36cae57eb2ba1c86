// Playback time: runs, steps and seeks; listeners are called at each change. c: seconds of the clip.
// A video that plays is the clock: `driver` (see followVideo) then sets the time of each frame that it presents.

function makeClock(clip, changed) {
  let c = 0, time = clip.timeAt(0), playing = false, rate = clip.pace, loop = true, before = null, driver = null;

  function moved(to, change) {
    c = to;
    time = clip.timeAt(c);
    changed(change);
  }
  function end() {
    playing = false;
    moved(clip.length, { stopped: true });
  }
  function tick(now) {
    if (!playing) return;
    if (driver && driver.drives()) {
      before = null;
      if (driver.poll) clock.shown(driver.poll());
    } else {
      const to = before === null ? c : c + (Math.min(now - before, 250) / 1000) * (rate / clip.pace);
      before = now;
      if (to >= clip.length && !loop) { end(); return; }
      moved(to % clip.length, {});
    }
    requestAnimationFrame(tick);
  }

  const clock = {
    get time() { return time; },
    get clip() { return c; },
    get playing() { return playing; },
    get rate() { return rate; },
    get loop() { return loop; },
    set driver(value) { driver = value; },
    set rate(value) { rate = value; changed({ paced: true }); },
    set loop(value) { loop = value; changed({ paced: true }); },
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
    shown(at) { if (playing) moved(at, {}); },
    ended() { if (playing) end(); },
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

// The rendered video. Where it is seen and plays, it drives the clock; else it is held at the clock's frame.
function followVideo(video, clip, clock, seen) {
  const SLOWEST = 0.0625, FASTEST = 16; // rates that browsers play
  const frameOf = (c) => Math.floor(clamp(c * clip.fps + 1e-3, 0, clip.frames - 1));
  const pace = () => clock.rate / clip.pace;
  let wanted = null, refused = false;
  const drives = () => seen() && !refused && video.readyState > 0 && pace() >= SLOWEST && pace() <= FASTEST;

  function seek(c) {
    if (video.seeking) { wanted = c; return; }
    wanted = null;
    video.currentTime = (frameOf(c) + 0.5) / clip.fps; // the middle of a frame, where no rounding shows its neighbour
  }
  video.addEventListener("seeked", () => { if (wanted !== null) seek(wanted); });
  video.addEventListener("ended", () => { if (drives()) clock.ended(); });
  if (video.requestVideoFrameCallback) {
    const present = (now, { mediaTime }) => {
      if (clock.playing && drives() && !video.seeking) clock.shown(mediaTime);
      video.requestVideoFrameCallback(present);
    };
    video.requestVideoFrameCallback(present);
  }

  return {
    drives,
    poll: video.requestVideoFrameCallback ? null : () => video.currentTime,
    follow({ started, stopped, sought, paced } = {}) {
      if (video.readyState < 1 || !seen()) { if (!video.paused) video.pause(); return; }
      if (clock.playing && drives()) {
        video.loop = clock.loop;
        if (video.playbackRate !== pace()) video.playbackRate = pace();
        if ((started || sought || video.paused) && frameOf(video.currentTime - 1e-3) !== frameOf(clock.clip)) seek(clock.clip);
        if (video.paused) video.play().catch(() => { refused = true; });
        return;
      }
      if (!video.paused) video.pause();
      if (stopped || sought || paced || started || clock.playing) seek(clock.clip);
    },
  };
}
