// One clip, or the clips of a cell, at full size in a window of its own.
const dialog = part("look"), inside = dialog.lastElementChild;

function look(found) {
  const clip = clips[found[0]];
  document.getElementById("look-name").textContent = found.length > 1 ? `${found.length} clips` : clip.name;
  if (found.length > 1 || clip.failed) {
    const list = make("ul", { className: "clips" }, found.map(n => cards[n].cloneNode(true)));
    for (const card of list.children) {
      card.hidden = false;
      card.querySelector(".run")?.remove();
      card.querySelector("button.open")?.addEventListener("click", () => look([Number(card.dataset.n)]));
    }
    inside.replaceChildren(list);
  } else {
    const film = clip.kind === "video/mp4" ? make("video", { controls: true, loop: true, muted: true, playsInline: true, src: filmOf(found[0]) }) : make("img", { alt: "", src: clip.kind ? filmOf(found[0]) : poster(found[0])?.src ?? "" });
    inside.replaceChildren(film, make("ul", {}, clip.notes.map(text => make("li", { text }))));
    if (!still.matches) film.play?.().catch(() => {});
  }
  if (!dialog.open) dialog.showModal();
}

dialog.addEventListener("close", () => inside.replaceChildren());
dialog.addEventListener("click", event => { if (event.target === dialog) dialog.close(); });
