/* ---- the film: points of one frame, then corrections of its track, saved as they are clicked ---- */
let about = null, opening = null, corrected = new Map();   // corrections by frame: by marker [x, y], or null where it is hidden
const tracked = n => about?.track && n >= about.track.first && n < about.track.first + about.track.frames ? row(about.track.positions, n - about.track.first, names.length) : undefined;
const asked = () => {  // the film with what the list has of it
  const { path, reference, trial } = project.films.find(one => one.path === get("film").value) ?? {};
  if (!path) throw new Error("No film is in this folder: put some there and load the page again.");
  return Object.fromEntries(Object.entries({ film: path, robot: get("robot").value, midline: get("midline").checked, reference, trial }).filter(([, value]) => value));
};
async function film() {
  if (!saved) keepMarks();
  if (playing) pause();
  about = frame = opening = null; points = []; update();
  const own = opening = asked();
  update();
  const found = await call("film", null, own).catch(error => { opening = null; update(); throw error; });
  if (opening !== own) return;   // another one was chosen meanwhile
  about = { path: own.film, ...found };
  if (about.track) about.track.positions = unpacked(about.track.positions);
  ({ names, places, video } = about);
  load(about, 0, about.frames - 1);
  corrected = new Map((about.corrections?.frames ?? []).map(({ frame, markers }) => [frame, markers]));
  get("about").textContent = `${width} × ${height} px, ${about.frames} frames, ${about.fps.toFixed(2)} per second`;
  get("list").replaceChildren(...items());
  get("track").textContent = about.track ? "Track again" : "Track";
  get("hide").hidden = get("doubt").hidden = !about.track; get("midline").parentNode.hidden = Boolean(about.track);
  get("doubts").replaceChildren(...(about.track?.stretches ?? []).map(([first, to, reason]) => {
    const part = document.createElement("i"), share = n => `${100 * (about.track.first + n) / about.frames}%`;
    part.className = reason; part.style.left = share(first); part.style.width = share(to + 1 - first);
    return part;
  }));
  get("findings").replaceChildren(...(about.track?.findings ?? []).map(text => Object.assign(document.createElement("li"), { textContent: text })));
  fit();
  await go(about.track ? about.track.first : about.points?.frame ?? 0);
}
const tracking = () => job.running && job.kind === "track" && job.film === reel.path;
function seen() {
  if (!about) return draw();
  const own = about.track ? corrected.get(number) : number === (about.points?.frame ?? 0) ? about.points?.markers : null;
  points = names.map((name, m) => own?.[name] !== undefined ? own[name] : tracked(number)?.[m] ?? null);
  chosen = lifted = wanted = -1; history = []; lastStep = ""; marked = number;
  update();
}
let marked = 0;   // the frame that the points are of
function keepMarks() {
  saved = true;
  let content = { format: 1, video, width, height };
  if (about.track) {
    const before = tracked(marked) ?? [], mine = {};
    names.forEach((name, m) => {
      const [p, q] = [points[m], before[m]];
      if (p ? !q || Math.hypot(p[0] - q[0], p[1] - q[1]) > 0.01 : q) mine[name] = p;
    });
    if (Object.keys(mine).length) corrected.set(marked, mine); else corrected.delete(marked);
    content = { ...content, frames: [...corrected].sort(([a], [b]) => a - b).map(([frame, markers]) => ({ frame, markers })) };
  } else {
    const mine = Object.fromEntries(names.flatMap((name, m) => points[m] ? [[name, points[m]]] : []));
    const whole = about.points && Object.keys(about.points.markers ?? {}).length === names.length;
    if (whole && marked !== (about.points.frame ?? 0) && Object.keys(mine).length < names.length) return;  // of another frame
    about.points = content = { ...content, frame: marked, markers: mine };
  }
  const asked = { film: about.path, kind: about.track ? "corrections" : "points", content };
  saving = saving.then(() => call("mark", asked)).catch(error => { saved = false; complain(error.message); });
}
let saving = Promise.resolve();   // one after the other
setInterval(() => { if (filming && !saved && !gesture) keepMarks(); }, 300);
get("clear").onclick = () => {
  if (!about?.track) return clear();
  remember(); points = names.map((_, m) => tracked(number)?.[m] ?? null); update();   // as the track has it
};
get("hide").onclick = () => {
  if (chosen < 0) return complain("Click the marker first.");
  remember(); points[chosen] = null; chosen = lifted = -1; update();
};
get("doubt").onclick = tried(async () => {   // the next click puts its first marker
  const { first, stretches } = about.track, sorted = [...stretches].sort(([a], [b]) => a - b);
  if (!sorted.length) throw new Error("Nothing of this track is lost or doubtful.");
  const [frame, , , [m]] = sorted.find(([one]) => first + one > number) ?? sorted[0];
  await go(first + frame);
  const at = points[m] ?? tracked(number - 1)?.[m];
  if (points[m]) chosen = lifted = m; else wanted = m;
  if (at) show(at);
  update();
});
document.addEventListener("keydown", ({ key, ctrlKey, metaKey }) => {
  if (filming && about?.track && !ctrlKey && !metaKey) ({ n: get("doubt"), h: get("hide") })[key]?.click();
});
get("track").onclick = tried(async () => { if (!saved) keepMarks(); await saving; await call("track", asked()); await watch(); });
get("film").onchange = get("midline").onchange = tried(film);
