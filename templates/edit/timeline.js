// Marks on the slider of time: contacts as they begin, impacts, and how long forces act; and the number of the frame.

import { element, part } from "./elements.js";

const MOST = 400; // marks of a kind

export function start(editor) {
  const marks = element("div.marks", { "data-part": "marks", "aria-hidden": "true" });
  part("seek").after(marks);
  const place = (time, end) => `${(100 * time) / end}%`;
  function draw(run) {
    const { data, end } = run;
    if (!(end > 0)) { marks.replaceChildren(); return; }
    const begins = data.touches.filter(([, , begin]) => begin > 0 && begin <= end).slice(0, MOST);
    const contacts = begins.map(([one, other, begin]) => {
      const names = [one, other].map((k) => data.bodies[k]?.name ?? data.walls[k - data.bodies.length]?.name ?? "");
      const mark = element("i.contact", { title: `${names.join(" and ")} touch at ${begin.toFixed(2)} s` });
      mark.style.left = place(begin, end);
      return mark;
    });
    const forces = data.pushes.slice(0, MOST).map((push) => {
      const mark = element("i.force", { title: `${push.load} on ${data.bodies[push.body]?.name ?? ""}` });
      mark.style.left = place(Math.max(push.start, 0), end);
      mark.style.width = `max(3px, ${place(Math.max(Math.min(push.end, end) - push.start, 0), end)})`;
      return mark;
    });
    marks.replaceChildren(...forces, ...contacts);
    marks.dataset.contacts = contacts.length;
    marks.dataset.forces = forces.length;
  }
  editor.on("motion", draw);
  editor.on("whole", draw);
  editor.on("time", (time) => {
    const { clip } = editor.player.run;
    part("frame").textContent = `${Math.round(clip.frameAt(Math.min(time, editor.player.run.motion.end))) + 1}`;
    part("frames").textContent = String(editor.player.run.data.allFrames.length);
  });
}
