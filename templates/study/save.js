// Answers of a rater -> the file that physgen reads.
function record() {
  const { rater, session, started, order, answers, left } = own();
  const answered = Object.fromEntries(order.filter(name => answers[name] && data.questions.some(({ key }) => answers[name][key])).map(name => [name, answers[name]]));
  return JSON.stringify({ [data.form]: data.version, study: data.study, rater, session, started, saved: new Date().toISOString(), order, left_out: left, answers: answered }, null, 1);
}

function save() {
  const name = `answers-${own().rater.replace(/[^\p{L}\p{N}]+/gu, "-").replace(/^-|-$/g, "") || "rater"}.json`;
  const url = URL.createObjectURL(new Blob([record(), "\n"], { type: "application/json" }));
  const link = Object.assign(document.createElement("a"), { href: url, download: name });
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(url), 60000);
  own().saved = rated();
  writeBook();
  part("saved").textContent = `Saved as ${name}, where your browser keeps downloads.`;
}
