// The seam between a photo and its result: dragged by the pointer, moved by arrow keys.
const SEAM = 50; // % of the width at which it begins

function addSlide(box) {
  const seam = box.querySelector(".seam");
  if (!seam || box.querySelector(".slide")) return;
  const slider = make("input", { type: "range", className: "slide", min: 0, max: 100, step: 1, value: SEAM });
  slider.setAttribute("aria-label", `${box.dataset.slide}: share of the photo`);
  const put = () => {
    box.style.setProperty("--at", `${slider.value}%`);
    slider.setAttribute("aria-valuetext", `${slider.value} % photo, ${100 - slider.value} % result`);
  };
  const follow = event => {
    const { left, width } = box.getBoundingClientRect();
    slider.value = (100 * (event.clientX - left)) / width;
    put();
  };
  slider.addEventListener("input", put);
  slider.addEventListener("keydown", event => event.stopPropagation()); // a card's arrow keys go to its neighbours
  seam.classList.add("dragged");
  seam.addEventListener("pointerdown", event => { event.preventDefault(); seam.setPointerCapture(event.pointerId); });
  seam.addEventListener("pointermove", event => { if (seam.hasPointerCapture(event.pointerId)) follow(event); });
  seam.addEventListener("click", event => event.stopPropagation()); // it does not play the card
  box.append(slider);
  put();
}
