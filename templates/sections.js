{
  // the section that is being read is marked in the navigation, which stays
  const links = [...document.querySelectorAll(".top nav a")];
  const mark = () => {
    const reached = links.filter((link) => {
      const section = document.querySelector(link.hash);
      return section && !section.hidden && section.getBoundingClientRect().top < innerHeight / 3;
    });
    const end = innerHeight + scrollY > document.documentElement.scrollHeight - 4;
    const now = end && scrollY ? links.at(-1) : reached.at(-1) ?? links[0];
    links.forEach((link) => link === now ? link.setAttribute("aria-current", "true") : link.removeAttribute("aria-current"));
  };
  addEventListener("scroll", mark, { passive: true });
  mark();
}
{
  // on a phone, sections after the charts are folded: their titles open them, and so do links to them
  const narrow = matchMedia("(max-width: 640px)");
  const folds = [...document.querySelectorAll("main > section")].filter((section) => section.querySelector(":scope > h2") && section.id !== "refinement");
  const put = (section, open) => {
    section.classList.toggle("folded", !open);
    section.querySelector("h2 button").setAttribute("aria-expanded", open);
  };
  const reveal = () => {
    const section = location.hash.length > 1 ? document.getElementById(decodeURIComponent(location.hash.slice(1)))?.closest("section") : null;
    if (folds.includes(section) && section.classList.contains("folded")) { put(section, true); section.scrollIntoView(); }
  };
  if (narrow.matches) {
    for (const section of folds) {
      const title = section.querySelector(":scope > h2"), button = document.createElement("button");
      button.type = "button";
      button.className = "fold";
      button.append(...title.childNodes);
      title.append(button);
      button.addEventListener("click", () => put(section, section.classList.contains("folded")));
      put(section, false);
    }
    addEventListener("hashchange", reveal);
    reveal();
  }
}
