document.querySelectorAll("[data-copy]").forEach((box) => {
  const button = box.querySelector("button");
  const label = button.textContent;
  button.hidden = false;
  button.addEventListener("click", async () => {
    const text = box.querySelector("code").textContent;
    let done = true;
    try {
      await navigator.clipboard.writeText(text);
    } catch {  // an older browser, or one that asks leave
      const range = document.createRange();
      range.selectNodeContents(box.querySelector("code"));
      getSelection().removeAllRanges();
      getSelection().addRange(range);
      done = document.execCommand("copy");
    }
    button.textContent = done ? "Copied" : "Press Ctrl+C";
    box.querySelector("[role=status]").textContent = done ? "Copied" : "";
    setTimeout(() => { button.textContent = label; }, 1800);
  });
});
