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
