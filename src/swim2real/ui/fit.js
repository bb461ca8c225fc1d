/* ---- the fit: a simulation is under way at a time, the newest values next; all trials once the hand rests ---- */
let values = {}, parameters = [], past = [], dragging = false, trial = "", busy = false, again = false, rest = 0;
let shown = null, simulated = [];   // the scene of the trial that is shown; simulated places
function under(put) {
  const k = number - reel.first, live = filming && number === job.done - 1 && job.film === reel.path && job.places;
  const rings = filming
    ? [[live ? row(unpacked(job.places), 0, unpacked(job.places).length / 2) : playing ? tracked(number) : [], "#ffffff", false]]
    : shown ? [[row(shown.real, k, shown.markers), "#ff5a52", false], [row(simulated, k, shown.markers), "#3f9bff", true]] : [];
  for (const [places, color, joined] of rings) {
    const seen = (places ?? []).filter(Boolean).map(put);
    context.strokeStyle = color; context.lineWidth = 2;
    context.beginPath();
    if (joined) seen.forEach(([x, y]) => context.lineTo(x, y));
    for (const [x, y] of seen) { context.moveTo(x + 5, y); context.arc(x, y, 5, 0, 7); }
    context.stroke();
  }
}
let posed = {};   // what the sliders are of
const fitted = () => ({ reference: get("reference").value, robot: get("robot").value, run: chosenRun().run ?? null });
let left = true;   // whether the sliders can be found again as they stand
const leave = () => { left = true; outbox = outbox.filter(([name]) => name !== "keep"); return post("keep", { ...posed, values, held: held(), left }); };
async function simulate() {
  again = true;
  if (busy) return;
  busy = true; clearTimeout(rest);
  const slow = setTimeout(() => { get("note").textContent = `Simulating … ${COMPILING}`; }, 3000);
  try {
    while (again && !filming) {
      again = false;
      if (shown?.trial !== trial) await stage();
      if (filming) break;
      const answer = await call("simulate", { ...posed, values, trial });
      if (shown?.trial in answer.errors) simulated = unpacked(answer.simulated);
      errors(answer);
      if (get("note").textContent.startsWith("Simulating")) get("note").textContent = shown?.note ?? "";
      if (!filming) draw();
    }
    rest = setTimeout(tried(async () => { if (!left) leave(); if (!busy) errors(await call("simulate", { ...posed, values })); }), 300);
  } finally { busy = false; clearTimeout(slow); }
}
async function stage() {  // what the trial is drawn on
  const scene = await call("scene", { ...posed, trial });
  if (filming) return;   // the person has turned to the films meanwhile
  scene.real = unpacked(scene.real); simulated = [];
  const last = scene.real.length / (2 * scene.markers) - 1, [width, height] = scene.size;
  if (playing) pause();
  shown = scene; names = []; points = [];
  get("note").textContent = scene.note ||= scene.film ? "" : "No film of this trial is in the folder: it is drawn on the ground.";
  load({ fps: last / scene.seconds, ...scene, path: scene.film, width, height }, scene.first, scene.first + last);
  near(Array.from({ length: last + 1 }, (_, k) => row(scene.real, k, scene.markers)).flat().filter(Boolean));
  get("time").value = last;
  await go(scene.first + last);
}
function near(spots) {  // as close as shows all of them
  const [xs, ys] = [0, 1].map(axis => spots.map(spot => spot[axis])), ends = list => [Math.min(...list), Math.max(...list)];
  const [[left, right], [top, bottom], [w, h]] = [ends(xs), ends(ys), size()];
  fit();
  if (spots.length) look(Math.min(0.7 * w / (right - left), 0.7 * h / (bottom - top), 3), w / 2, h / 2, ...toCss([(left + right) / 2, (top + bottom) / 2]));
}
function errors({ errors, diverged, small }) {
  for (const card of get("trials").children) {
    const { name } = card.dataset;
    if (name in errors) card.querySelector("output").textContent = name in diverged ? "diverged" : errors[name] === null ? "–" : `${(1e3 * errors[name]).toFixed(2)} mm`;
    [...card.querySelectorAll("path")].forEach((path, i) => { if (name in small) path.setAttribute("d", small[name][i]); });
  }
}
// a slider is linear in the value, or in its logarithm where the search is
const ends = p => [p.lower, p.upper, p.log_offset ?? 0];
function there(p, v) {
  const [low, high, c] = ends(p);
  return p.log_offset === null ? (v - low) / (high - low) : Math.log((v + c) / (low + c)) / Math.log((high + c) / (low + c));
}
function here(p, s) {
  const [low, high, c] = ends(p);
  return clamp(p.log_offset === null ? low + s * (high - low) : (low + c) * ((high + c) / (low + c)) ** s - c, low, high);
}
const digits = v => +v.toPrecision(3);
function put(now) {
  values = { ...now };
  for (const p of parameters) { p.input.value = there(p, values[p.name]); p.output.textContent = digits(values[p.name]); }
}
function slider(p) {
  const label = document.createElement("label"), name = document.createElement("b"), { known, interval_95: [low, high] = [] } = p.found ?? {};
  label.className = known ?? "";
  label.title = `${known ? `${known}: 95 % interval ${digits(low)} to ${digits(high)}. ` : ""}${p.meaning} From ${digits(p.lower)} to ${digits(p.upper)} ${p.unit}; ${digits(p.published)} in the model.`;
  name.textContent = known === "undetermined" ? `${p.name}, undetermined: ${digits(low)} to ${digits(high)}` : p.name;
  p.output = document.createElement("output");
  p.input = Object.assign(document.createElement("input"), { type: "range", min: 0, max: 1, step: 0.002, name: p.name });
  p.input.oninput = tried(() => {
    if (!dragging) past.push({ ...values });
    dragging = true; left = false;
    values[p.name] = here(p, +p.input.value);
    p.output.textContent = digits(values[p.name]);
    return simulate();
  });
  p.input.onchange = () => { dragging = false; };
  label.append(name, p.output, p.input);
  return label;
}
const held = () => [...get("trials").querySelectorAll("input:checked")].map(one => one.value);
function card(name, isHeld) {  // of a trial: its small picture, its error, and whether a search sees it
  const item = document.createElement("div"), button = document.createElement("button"), label = document.createElement("label");
  item.dataset.name = name; button.type = "button";
  button.innerHTML = `<svg viewBox="0 0 128 56" aria-hidden="true"><path class="real"/><path class="simulated"/></svg><b>${safe(name)}</b> <output></output>`;
  button.onclick = tried(() => choose(name));
  label.title = "No search sees this trial: its error is a test";
  label.append(Object.assign(document.createElement("input"), { type: "checkbox", value: name, checked: isHeld, onchange: leave }), " hold out");
  item.append(button, label);
  return item;
}
async function sliders(begin) {  // with what a study of the run has found
  const asked = fitted(), about = await call("fit", { ...asked, begin: get("from").value || null });
  posed = asked;
  parameters = about.parameters.map(p => ({ ...p, found: about.intervals[p.name] }));
  get("sliders").replaceChildren(...parameters.map(slider));
  put(begin ?? about.values);
  return about;
}
async function open() {
  if (!get("reference").value) return complain("No trials are in this folder yet: track a film first.");
  const about = await sliders();
  get("trials").replaceChildren(...about.trials.map(name => card(name, about.held.includes(name))));
  past = []; shown = null;
  await Promise.all([results(), choose(about.trials.includes(trial) ? trial : about.trials[0])]);
}
async function results() {  // verdict, and speeds over the frequency of the beat, held-out trials open, where there is one
  const { run } = chosenRun(), { verdict, sentence } = chosenRun(run);
  get("results").hidden = !run;
  get("verdict").innerHTML = verdict ? `<b>${safe(verdict)}</b>: ${safe(sentence)}` : !run ? "" : "No verdict: this search was cut off; it can go on.";
  get("speeds").innerHTML = run ? (await call("speeds", null, { run })).svg : "";
}
async function choose(name) {
  trial = name;
  for (const { dataset, firstChild } of get("trials").children) firstChild.setAttribute("aria-pressed", dataset.name === name);
  await simulate();
}
get("back").onclick = tried(() => { if (!past.length) throw new Error("There is nothing to undo."); put(past.pop()); left = false; return simulate(); });
get("reference").onchange = tried(() => { get("from").value = ""; shown = null; return open(); });
get("from").onchange = tried(() => {
  if (get("from").value) take(chosenRun());
  return open();
});
get("search").onclick = tried(async () => { await call("search", { ...posed, values, held: held() }); await watch(); });
get("ask").onclick = tried(async () => { await call("ask", { ...posed, values }); await watch(); });
get("keep").onclick = tried(async () => { get("note").textContent = (await call("keep", { ...posed, values, held: held() })).said; });
for (const button of document.querySelectorAll("[data-work]"))
  button.onclick = tried(async () => { await call("work", { kind: button.dataset.work, run: chosenRun().run }); await watch(); });
