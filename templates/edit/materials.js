// Materials of the table: friction, elasticity and rolling as they stand there, and the mass as far as it is known.

export function makeMaterials(editor) {
  const scene = () => editor.state.scene,
    derived = (name) => editor.state.derived.objects[name],
    meter = () => editor.state.derived.pixels_per_meter;
  const material = (label) => {
    const words = ` ${String(label || "").toLowerCase()} `;
    let best = null;
    for (const m of editor.materials)
      for (const word of [m.name, ...(m.words || [])])
        if (words.includes(` ${word.replace(/-/g, " ")} `) && (!best || word.length > best.word.length)) best = { m, word };
    return best?.m || null;
  };
  function madeOf(name, value) {
    const m = editor.materials.find((one) => one.name === value),
      item = scene().objects[name],
      { mass, radius, ball } = derived(name),
      ops = [];
    if (!m) return ops;
    const before = material(item.label),
      cm = 100 / meter();
    let grams = null;
    if (ball && radius && editor.state.derived.scaled) grams = (4 / 3) * Math.PI * (radius * cm) ** 3 * m.density;
    else if (before && before !== m) grams = (mass * m.density) / before.density;
    for (const key of ["friction", "elasticity", "rolling"]) ops.push({ set: ["objects", name, key], value: m[key] });
    if (grams) ops.push({ set: ["objects", name, "mass"], value: +grams.toPrecision(3) });
    const from = item.from || {},
      gone = Object.keys(from).filter((key) => ["friction", "elasticity", "rolling", ...(grams ? ["mass"] : [])].includes(key));
    if (!editor.variant && gone.length) {
      if (gone.length === Object.keys(from).length) ops.push({ unset: ["objects", name, "from"] });
      else for (const key of gone) ops.push({ unset: ["objects", name, "from", key] });
    }
    return ops;
  }
  const current = (name) => {
    const item = scene().objects[name],
      alike = (m) => ["friction", "elasticity", "rolling"].every((key) => Math.abs((item[key] ?? NaN) - m[key]) < 1e-9);
    const guess = material(item.label);
    return (guess && alike(guess) ? guess : editor.materials.find(alike))?.name ?? null;
  };
  return { madeOf, current };
}
