document.querySelectorAll("[data-compare]").forEach((figure) => {
  const slider = figure.querySelector("input");
  const show = () => {
    figure.style.setProperty("--at", `${slider.value}%`);
    slider.setAttribute("aria-valuetext", `${slider.value} % ${slider.dataset.name}`);
  };
  slider.hidden = false;
  figure.classList.add("live");
  slider.addEventListener("input", show);
  show();
});
