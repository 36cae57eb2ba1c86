// A question -> the person's choice, in a dialog that keyboards and screen readers know; one at a time.
import { element } from "./elements.js";

let before = Promise.resolve();
let count = 0;

// title; body: text or nodes; choices: [{value, label, main, bad}]; input: {label, value, check(text) -> what is wrong or null}.
// -> the choice's value (with an input: {value, text}), or null where the person went back (Escape).
export function ask(question) {
  const answer = before.then(() => shown(question));
  before = answer.catch(() => {});
  return answer;
}

// For a message that needs no choice.
export const tell = (title, body) => ask({ title, body, choices: [{ value: true, label: "Close", main: true }] });

function shown({ title, body, choices, input }) {
  count += 1;
  const name = `dialog-${count}`;
  const field = input && element("input", { type: "text", id: `${name}-field`, value: input.value ?? "", autocomplete: "off", spellcheck: "false", maxlength: 200 });
  const wrong = input && element("p.wrong", { id: `${name}-wrong`, role: "alert" });
  if (field) field.setAttribute("aria-describedby", wrong.id);
  const buttons = choices.map((choice) => element(`button.${choice.main ? "main" : choice.bad ? "bad" : "plain"}`, { type: "button", "data-value": String(choice.value) }, choice.label));
  const form = element("form", { method: "dialog" },
    element("h2", { id: `${name}-title` }, title),
    body && element("div.dialog-body", {}, ...(typeof body === "string" ? [element("p", {}, body)] : [body].flat())),
    field && element("p.dialog-field", {}, element("label", { for: field.id }, input.label), field, wrong),
    element("div.dialog-choices", {}, ...buttons));
  const dialog = element("dialog.ask", { "aria-labelledby": `${name}-title` }, form);
  document.body.append(dialog);
  const opener = document.activeElement;
  return new Promise((done) => {
    let answer = null;
    const close = (value) => { answer = value; dialog.close(); };
    const choose = (choice) => {
      if (!field || choice.value === null) return close(choice.value);
      const reason = input.check?.(field.value.trim()) ?? null;
      wrong.textContent = reason ?? "";
      field.setAttribute("aria-invalid", String(Boolean(reason)));
      if (reason) return field.focus();
      return close({ value: choice.value, text: field.value.trim() });
    };
    choices.forEach((choice, k) => buttons[k].addEventListener("click", () => choose(choice)));
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      const main = choices.find((choice) => choice.main);
      if (main) choose(main);
    });
    dialog.addEventListener("keydown", (event) => event.stopPropagation()); // the page's own keys are not for here
    dialog.addEventListener("close", () => {
      dialog.remove();
      if (opener?.isConnected) opener.focus({ preventScroll: true });
      done(answer);
    });
    dialog.showModal();
    if (field) { field.focus(); field.select(); } else (buttons[choices.findIndex((choice) => choice.main)] ?? buttons[0]).focus();
  });
}
