/* ---- the job that is under way, whoever began it ---- */
let job = { number: -1, bests: [], running: false }, timer = 0, followed = "", cut = false;
async function watch() {
  clearTimeout(timer);
  let wait = 2000;
  try {
    const now = await call("job"), ended = job.running && !now.running || now.number > job.number && job.number >= 0 && !now.running;
    const changed = now.running !== job.running;
    job = now;
    if (changed && filming) update();
    if (cut) { cut = false; get("alert").textContent = ""; }
    if (job.running) wait = 300;
    get("job").hidden = !job.title;
    get("doing").textContent = job.title;
    get("progress").textContent = [job.done && `${job.done}${job.total ? ` of ${job.total}` : ""}`, job.bests.length && `${job.bests.at(-1)[1].toFixed(2)} mm`, `${job.seconds} s`].filter(Boolean).join(" · ");
    get("said").textContent = job.fault || job.said || (job.stopping ? "ending …" : !job.done && job.seconds > 3 ? COMPILING : job.warning);
    get("stop").hidden = !job.running; get("stop").disabled = job.stopping;
    chart(job.bests);
    const news = JSON.stringify(job.values);
    if (trial && news !== followed && news !== "null" && !dragging && parameters.every(p => p.name in JSON.parse(news)) && (job.running || ended)) {
      if (job.kind === "ask" || !followed) past.push({ ...values });
      put(JSON.parse(news));
      if (!filming) simulate().catch(error => complain(error.message));
    }
    if (filming && job.running && job.places && job.film === reel.path && !fetching) go(job.done - 1).catch(() => {});
    followed = job.running || ended ? news : "";
    if (ended) { await list(); if (job.run) { get("from").value = job.run; await results(); } if (job.kind === "track" && filming) await film(); if (job.kind === "identify" && !filming) await sliders(values); }
  } catch (error) { cut = true; complain(error.message); }
  timer = setTimeout(watch, wait);
}
function chart(bests) {
  get("chart").style.display = bests.length > 1 ? "" : "none";
  if (bests.length < 2) return;
  const logs = bests.map(([, best]) => Math.log(best)), low = Math.min(...logs), high = Math.max(...logs) + 1e-9, most = job.done || 1;
  get("chart").innerHTML = `<path d="M${bests.map(([done], i) => `${280 * done / most} ${42 - 40 * (logs[i] - low) / (high - low)}`).join("L")}H280"/>`;
}
get("stop").onclick = tried(() => call("stop", {}).then(watch));

/* ---- the folder ---- */
let project = {};
async function list() {
  project = await call("project");
  get("folder").textContent = project.folder;
  options("robot", project.robots.map(robot => [robot, robot]));
  options("film", project.films.map(film => [film.path, `${film.path}${film.trial ? " ✓" : film.points ? " ·" : ""}`]));
  options("reference", project.references.map(one => [one.path, `${one.path}: ${Object.keys(one.trials).length} trial${Object.keys(one.trials).length === 1 ? "" : "s"}`]));
  const runs = project.runs.filter(run => run.usable && run.reference && run.robot);
  options("from", [["", "values of the model"], ...runs.map(run => [run.path, `${run.path}${run.error === null ? "" : `: ${(1e3 * run.error).toFixed(2)} mm`}${run.verdict ? `, ${run.verdict}` : ""}`])]);
}
async function turn(toFilm) {
  if (playing) pause();
  if (!saved) keepMarks();
  filming = toFilm; frame = shown = opening = null;
  get("filming").hidden = !filming; get("fitting").hidden = filming; get("doubts").hidden = !filming;
  get("tofilm").setAttribute("aria-pressed", filming); get("tofit").setAttribute("aria-pressed", !filming);
  await (filming ? film() : open());
}
get("tofilm").onclick = tried(() => turn(true));
get("tofit").onclick = tried(() => turn(false));
get("robot").onchange = tried(() => turn(filming));
document.querySelector("aside").addEventListener("keydown", event => { if (event.target.matches("input, select")) event.stopPropagation(); });
