// A second clip beside the first, the photo over it, a frame as a file, and the clips before and after in a gallery.

const DRIFT = 0.05; // s by which the second video may be off while it plays
const RELATIVE = /^(\.\.\/)*([^/:?#\\\x00-\x20]+\/)*[^/:?#\\\x00-\x20]+\.html$/; // a page on this side, by no scheme and no host

function makeSecond(root, clock, clip) {
  const $ = (name) => root.querySelector(`[data-part="${name}"]`);
  const video = $("other"), figure = $("second");
  let shown = null; // an address that the page made, to be given back

  function open(source, name) {
    if (shown) URL.revokeObjectURL(shown);
    shown = source.startsWith("blob:") ? source : null;
    figure.hidden = !source;
    root.classList.toggle("compared", Boolean(source));
    if (!source) { video.removeAttribute("src"); video.load(); return; }
    $("other-name").textContent = `${name}, at the same time`;
    video.src = source;
  }
  function follow() {
    if (figure.hidden || video.readyState < 1) return;
    const due = Math.min(clock.clip, Math.max(video.duration - 0.5 / clip.fps, 0)), over = due < clock.clip;
    if (clock.playing && !over) {
      video.playbackRate = Math.min(Math.max(clock.rate / clip.pace, 0.0625), 16);
      if (Math.abs(video.currentTime - due) > DRIFT && !video.seeking) video.currentTime = due;
      if (video.paused) video.play().catch(() => {});
      return;
    }
    if (!video.paused) video.pause();
    if (Math.abs(video.currentTime - due - 0.25 / clip.fps) > 0.4 / clip.fps) video.currentTime = due + 0.25 / clip.fps;
  }
  video.addEventListener("loadedmetadata", follow);
  $("file").addEventListener("change", () => {
    const [file] = $("file").files;
    if (file) open(URL.createObjectURL(file), file.name);
  });
  $("clips").addEventListener("change", () => {
    const choice = $("clips").selectedOptions[0];
    open(choice.value, choice.textContent);
  });
  return { follow };
}

// the photo over the left of the video, up to a seam
function makeSplit(root, view) {
  const $ = (name) => root.querySelector(`[data-part="${name}"]`);
  const button = $("split"), half = $("half");
  if (!button || !half) return;
  const slider = half.querySelector("input");
  const put = () => {
    half.style.setProperty("--at", `${slider.value}%`);
    slider.setAttribute("aria-valuetext", `${slider.value} % photo`);
  };
  slider.addEventListener("input", put);
  button.addEventListener("click", () => {
    half.hidden = !half.hidden;
    button.setAttribute("aria-pressed", !half.hidden);
    if (!half.hidden && root.dataset.view === "preview") view("video");
  });
  put();
}

// the frame as a PNG; a page from disk may not read its video, and saves the preview's
function saveFrame(video, size, paint, name, tell) {
  const [width, height] = video ? [video.videoWidth, video.videoHeight] : size;
  const canvas = tag("canvas", { width, height }), context = canvas.getContext("2d");
  const keep = (blob) => {
    const link = tag("a", { href: URL.createObjectURL(blob), download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  };
  if (video) {
    try {
      context.drawImage(video, 0, 0);
      canvas.toBlob(keep, "image/png");
      tell(`Saved ${name}`);
      return;
    } catch (error) { if (error.name !== "SecurityError") throw error; }
  }
  const [wide, high] = size, fresh = tag("canvas", { width: wide, height: high });
  paint(fresh.getContext("2d"));
  fresh.toBlob(keep, "image/png");
  tell(video ? `Saved ${name}, of the preview: a page from disk may not read its video` : `Saved ${name}`);
}

// the gallery that led here: back to it, to the clips before and after, and its clips to compare with
function readGallery(root, ways) {
  const page = new URLSearchParams(location.search).get("gallery");
  const $ = (name) => ways.querySelector(`[data-part="${name}"]`);
  if (!page || !RELATIVE.test(page)) {
    // opened by itself: back to the folder of the clips
    Object.assign($("home"), { href: "../", textContent: "Folder", hidden: false });
    return;
  }
  const home = new URL(page, location.href), way = $("home");
  if (home.protocol !== location.protocol || home.host !== location.host) return;
  way.href = home.href;
  way.hidden = false;
  const script = tag("script", { src: new URL(page.replace(/\.html$/, ".files/clips.js"), location.href).href });
  script.addEventListener("load", () => {
    const clips = (window.physgenClips ?? []).map((clip) => ({ ...clip, url: new URL(clip.href, home) }));
    const at = clips.findIndex((clip) => clip.url.pathname === location.pathname);
    if (at < 0) return;
    for (const [name, clip, mark] of [["earlier", clips[at - 1], "← "], ["later", clips[at + 1], " →"]]) {
      if (!clip) continue;
      const link = $(name), depth = clip.href.replace(/^\.\//, "").split("/").length - 1;
      link.textContent = name === "earlier" ? mark + clip.name : clip.name + mark;
      link.href = `${clip.url.href}?gallery=${"../".repeat(depth)}${page.split("/").pop()}`;
      link.hidden = clip.href.startsWith("../");
    }
    const others = clips.filter((clip, k) => k !== at && clip.film);
    const select = root.querySelector("[data-part=clips]");
    select.replaceChildren(tag("option", { value: "" }, "no clip"), ...others.map((clip) => tag("option", { value: new URL(clip.film, home).href }, clip.name)));
    root.querySelector("[data-part=with]").hidden = !others.length;
  });
  document.head.append(script);
}
