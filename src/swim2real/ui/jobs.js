/* ---- the job that is under way, whoever began it ---- */
const SILENT = [15, 4];   // s, after which a server that doesn't say how far it is has ended; and that is asked whether it is back
let job = { number: -1, bests: [], running: false, saves: 0 }, timer = 0, followed = "";
async function watch() {
  let wait = 2000;
  const late = setTimeout(() => line.abort(), 1000 * SILENT[+cut]);
  try {
    const now = await call("job").finally(() => clearTimeout(late)), ended = job.running && !now.running || now.number > job.number && job.number >= 0 && !now.running;
    const changed = now.running !== job.running, news = now.saves !== job.saves;
    job = now;
    if (changed && filming) update();
    if (cut) afresh().catch(error => complain(error.message));
    if (news) { await list(); if (filming) await remark(); }
    if (job.running) wait = 300;
    get("job").hidden = !job.title;
    get("doing").textContent = job.title;
    get("progress").textContent = [job.done && `${job.done}${job.total ? ` of ${job.total}` : ""}`, job.bests.length && `${job.bests.at(-1)[1].toFixed(2)} mm`, `${job.seconds} s`].filter(Boolean).join(" · ");
    get("said").textContent = job.fault || job.said || (job.stopping ? "ending …" : !job.done && job.seconds > 3 ? COMPILING : job.warning);
    get("stop").hidden = !job.running; get("stop").disabled = job.stopping;
    chart(job.bests);
    const best = JSON.stringify(job.values);
    if (trial && best !== followed && best !== "null" && !dragging && Object.keys(job.values).sort().join() === parameters.map(p => p.name).sort().join() && (job.running || ended)) {
      if (job.kind === "ask" || !followed) past.push({ ...values });
      put(job.values);
      if (job.kind === "ask") leave();
      if (!filming) simulate().catch(error => complain(error.message));
    }
    if (filming && job.running && job.places && job.film === reel.path && !fetching) go(job.done - 1).catch(() => {});
    followed = job.running || ended ? best : "";
    if (ended) { await list(); if (ours(job.run)) { get("from").value = job.run; posed = fitted(); await results(); } if (job.kind === "track" && filming && job.film === get("film").value) await film(); if (job.kind === "identify" && !filming) await sliders(values); }
  } catch (error) { complain(error.message); if (line.signal.aborted) line = new AbortController(); }
  clearTimeout(timer);
  timer = setTimeout(watch, wait);
}
function chart(bests) {
  get("chart").style.display = bests.length > 1 ? "" : "none";
  if (bests.length < 2) return;
  const logs = bests.map(([, best]) => Math.log(best)), low = Math.min(...logs), high = Math.max(...logs) + 1e-9, most = job.done || 1;
  get("chart").innerHTML = `<path d="M${bests.map(([done], i) => `${280 * done / most} ${42 - 40 * (logs[i] - low) / (high - low)}`).join("L")}H280"/>`;
}
get("stop").onclick = tried(() => call("stop", {}).then(watch));

async function afresh() {   // after a cut: what wasn't answered is asked for once more
  cut = false; get("alert").textContent = "";
  if (!project.films) return start();
  await send();
  await (filming ? about ? go(number) : film() : parameters.length ? simulate() : open());
}

/* ---- the folder ---- */
let project = {};
const chosenRun = (path = get("from").value) => project.runs.find(run => run.path === path) ?? {}, usable = run => run.usable && run.robot && run.reference;
const ours = path => chosenRun(path).robot === get("robot").value && chosenRun(path).reference === get("reference").value;
function take({ path, robot, reference }) { get("from").value = path; get("robot").value = robot; get("reference").value = reference; }
async function list() {
  project = await call("project");
  get("folder").textContent = project.folder;
  options("robot", project.robots.map(robot => [robot, robot]));
  options("film", project.films.map(film => [film.path, `${film.path}${film.trial ? " ✓" : film.points ? " ·" : ""}`]));
  options("reference", project.references.map(one => [one.path, `${one.path}: ${Object.keys(one.trials).length} trial${Object.keys(one.trials).length === 1 ? "" : "s"}`]));
  options("from", [["", "values of the model"], ...project.runs.filter(usable).map(run => [run.path, `${run.path}${run.error === null ? "" : `: ${(1e3 * run.error).toFixed(2)} mm`}${run.verdict ? `, ${run.verdict}` : ""}`])]);
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
get("robot").onchange = tried(() => { if (chosenRun().robot !== get("robot").value) get("from").value = ""; return turn(filming); });
document.querySelector("aside").addEventListener("keydown", event => { if (event.target.matches("input, select")) event.stopPropagation(); });
