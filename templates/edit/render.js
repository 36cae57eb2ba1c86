// The scene as a video: which variants, in which format, refined or not; progress, stop, the result, and the command that does the same.

import { element, isolated } from "./elements.js";

const FORMATS = { mp4: "Video (mp4)", gif: "GIF", webp: "WebP", png: "Frames (png)" };
const EVERY = 400; // ms between looks at a run whose events do not come

export function start(editor) {
  const which = element("div", { class: "render-which" });
  const format = element("select", { id: "render-format" }, ...Object.entries(FORMATS).map(([value, words]) => element("option", { value }, words)));
  const refine = element("input", { type: "checkbox", id: "render-refine" });
  const refined = element("span", { class: "note", id: "render-refined" });
  refine.setAttribute("aria-describedby", refined.id);
  const go = element("button", { type: "submit", class: "act main" }, "Render");
  const stop = element("button", { type: "button", class: "act", hidden: true, on: { click: halt } }, "Stop");
  const meter = element("progress", { max: 1, value: 0, "aria-label": "Progress of the render" });
  const stage = element("p", { class: "render-stage", role: "status" });
  const running = element("div", { class: "render-running", hidden: true }, meter, stage);
  const lines = element("pre", { class: "render-lines", tabindex: "0", "aria-label": "Output of the run" });
  const log = element("details", { class: "render-log", hidden: true }, element("summary", {}, "Output of the run"), lines);
  const failed = element("p", { class: "render-failed", role: "alert", hidden: true });
  const results = element("div", { class: "render-results" });
  const command = element("code", { class: "render-command", "data-part": "command" });
  const form = element("form", { class: "render sheet", on: { submit: (event) => { event.preventDefault(); begin(); } } },
    element("fieldset", {}, element("legend", {}, "What"), which),
    element("p", { class: "render-row" }, element("label", { for: "render-format" }, "As"), format),
    element("p", { class: "render-row" }, element("label", { class: "render-check" }, refine, " Refine with a video model"), refined),
    element("p", { class: "render-row" }, go, stop),
    running, failed, results, log,
    element("h3", {}, "Command line equivalent"),
    element("p", { class: "render-command-row" }, command, element("button", { type: "button", class: "act", on: { click: () => editor.copy(command.textContent) } }, "Copy")));
  const panel = editor.addPanel({ id: "render", title: "Render", element: form, order: 50 });
  let busy = false, ordering = false, looking = 0, wanted = 0, first = true, marked = null;

  const BASE = "";
  const picked = () => [...which.querySelectorAll("input:checked")].map((box) => (box.value === BASE ? null : box.value));

  editor.on("state", ({ state, before }) => {
    const names = state.variants ?? [];
    const had = marked === null ? [state.variant ?? BASE] : [...which.querySelectorAll("input:checked")].map((box) => box.value);
    if (marked !== JSON.stringify(names)) {
      marked = JSON.stringify(names);
      which.replaceChildren(...[BASE, ...names].map((name) => element("label", { class: "render-check" },
        element("input", { type: "checkbox", value: name, checked: had.includes(name), on: { change: showCommand } }), " ", name === BASE ? "the scene" : isolated(name))));
      if (!picked().length) which.querySelector("input").checked = true;
    } else if (before && (before.variant ?? null) !== (state.variant ?? null)) for (const box of which.querySelectorAll("input")) box.checked = box.value === (state.variant ?? BASE);
    const backend = state.scene?.refine?.backend ?? state.scene?.render?.refine ?? null;
    refine.disabled = !backend || backend === "none";
    refined.textContent = refine.disabled ? "The file names no backend: set refine.backend first. physgen backends lists them." : `By ${backend}.`;
    showCommand();
    if (first) { first = false; look(); }
  });
  format.addEventListener("change", showCommand);
  refine.addEventListener("change", showCommand);
  editor.on("panel", (id) => { if (id === "render") { showCommand(); look(); } });

  // the form -> whether it may be sent, and the command that does the same
  async function showCommand() {
    const errors = editor.state?.problems?.some((problem) => problem.severity === "error");
    go.disabled = busy || ordering || errors || !picked().length;
    go.title = errors ? "Fix the errors of the file first" : picked().length ? "" : "Choose what to render";
    if (panel.panel.hidden || !editor.state) return;
    const mine = (wanted += 1), chosen = picked();
    const line = (variant) => editor.request("GET", `/api/command?${new URLSearchParams({ format: format.value, refine: String(refine.checked || refine.disabled), ...(variant === null ? {} : { variant }) })}`);
    try {
      const found = await Promise.all(chosen.map(line));
      if (mine === wanted) command.textContent = found.map((one) => one.command).join(" && ");
    } catch (refused) {
      if (mine === wanted) command.textContent = refused.status ? refused.message : "";
    }
  }

  // what is rendered is what is seen, and all that was done is
  async function order() {
    for (let tries = 0; ; tries += 1) {
      await editor.idle();
      try {
        return await editor.request("POST", "/api/render", { version: editor.state.version, variants: picked(), format: format.value, refine: refine.checked || refine.disabled });
      } catch (refused) {
        if (refused.body?.version === undefined || tries === 4) throw refused;
        await editor.refresh();
      }
    }
  }

  async function begin() {
    if (ordering) return;
    failed.hidden = true;
    results.replaceChildren();
    ordering = go.disabled = true;
    try {
      if ((await editor.flush?.()) === false) return;
      await order();
      asked += 1;
      busy = true;
      shown({ running: true, stage: "starting", done: 0, total: 0, lines: [] });
      await editor.refresh(); // it was saved
      look();
    } catch (refused) {
      if (refused.body?.conflict) editor.saving?.(); else wrong(refused.message);
    } finally {
      ordering = false;
      showCommand();
    }
  }

  async function halt() {
    stop.disabled = true;
    stage.textContent = "Stopping …";
    try { await editor.request("POST", "/api/render/stop", {}); } catch (refused) { wrong(refused.message); }
    look();
  }

  function wrong(words) {
    failed.hidden = !words;
    failed.textContent = words ?? "";
  }

  let asked = 0; // an answer that another request overtook is out of date
  async function look() {
    clearTimeout(looking);
    const mine = (asked += 1);
    try {
      const run = await editor.request("GET", "/api/render");
      if (mine !== asked) return;
      shown(run);
    } catch { /* the banner reports a lost server */ }
    if (busy && mine === asked) looking = setTimeout(look, EVERY);
  }

  function shown(run) {
    const was = busy;
    busy = Boolean(run.running);
    running.hidden = stop.hidden = !busy;
    if (busy) {
      if (run.total) { meter.max = run.total; meter.value = run.done; } else meter.removeAttribute("value");
      const words = [run.stage, run.total ? `${Math.floor((100 * run.done) / run.total)} %` : ""].filter(Boolean).join(", ");
      if (stop.disabled && was) stage.textContent = "Stopping …"; else stage.textContent = words ? `${words[0].toUpperCase()}${words.slice(1)}` : "Working …";
    } else stop.disabled = false;
    panel.badge?.(busy ? (run.total ? `${Math.floor((100 * run.done) / run.total)} %` : "…") : null);
    const output = (run.lines ?? []).join("\n");
    if (lines.textContent !== output) { lines.textContent = output; lines.scrollTop = lines.scrollHeight; }
    log.hidden = !output;
    if (!busy && run.error) { wrong([run.error.message, run.error.fix].filter(Boolean).join("; ")); log.open = true; }
    if (!busy && run.result) came(run);
    if (was && !busy) editor.say(run.result?.length ? "Rendered: see the Render panel" : run.state === "stopped" ? "Stopped" : run.error?.message ?? "Stopped");
    if (was !== busy) showCommand();
  }

  // the videos, each with its report
  function came({ job, result: found }) {
    const key = JSON.stringify([job, found]);
    if (results.dataset.key === key && results.childElementCount) return;
    results.dataset.key = key;
    results.replaceChildren(...found.map(({ variant, folder, video, report }) => {
      const name = variant ?? "the scene", address = (file) => `/result/${job}/${folder}/${file}`;
      const film = !video ? null : /\.(gif|webp|png)$/.test(video) ? element("img", { src: address(video), alt: `Rendered: ${name}` })
        : element("video", { src: address(video), controls: true, loop: true, muted: true, playsinline: true, preload: "metadata", "aria-label": `Rendered: ${name}` });
      return element("figure", { class: "render-result" }, film, element("figcaption", {}, isolated(name), " ",
        report ? element("a", { href: address(report), target: "_blank", rel: "noopener" }, "Report") : null, " ",
        video ? element("a", { href: address(video), download: `${variant ?? "scene"}-${video}` }, "Download") : null));
    }));
  }
}
