/* ---- the film: points of one frame, then corrections of its track, saved as they are clicked ---- */
let about = null, opening = null, clicks = new Map();   // points or corrections by frame: by marker [x, y], or null where it is hidden
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
  try {
    const found = await call("film", null, own), there = await clicked(own, found.track);
    if (opening !== own) return;   // another one was chosen meanwhile
    about = { path: own.film, robot: own.robot, ...found }; clicks = there;
  } catch (error) { if (opening === own) opening = null; update(); throw error; }
  if (about.track) about.track.positions = unpacked(about.track.positions);
  ({ names, places } = about);
  load(about, 0, about.frames - 1);
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
  await go(about.track ? about.track.first : [...clicks.keys()][0] ?? 0);
}
const kind = track => track ? "corrections" : "points";
const clicked = async ({ film, robot }, track) => new Map(await call("marks", null, { film, robot, kind: kind(track) }));
async function remark() {   // what another page has clicked
  const { path } = about ?? {}, there = path && await clicked(asked(), about.track);
  if (!there || path !== about?.path || !saved || outbox.length || JSON.stringify([...there]) === JSON.stringify([...clicks])) return;
  clicks = there;
  if (!playing) seen();
}
const tracking = () => job.running && job.kind === "track" && job.film === reel.path;
function seen() {
  if (!about) return draw();
  const own = clicks.get(number);
  points = names.map((name, m) => own?.[name] !== undefined ? own[name] : tracked(number)?.[m] ?? null);
  chosen = lifted = wanted = -1; history = []; lastStep = ""; marked = number;
  update();
}
let marked = 0;   // the frame that the points are of
function keepMarks() {   // what has changed of them is saved
  saved = true;
  if (!about) return;
  const before = tracked(marked) ?? [], there = clicks.get(marked) ?? {}, mine = {};
  names.forEach((name, m) => {
    const [p, q] = [points[m], before[m]];
    if (p ? !q || apart(p, q) > 0.01 : q) mine[name] = p && [...p];
  });
  const drop = Object.keys(there).filter(name => !(name in mine)), count = one => Object.keys(one).length;
  const put = Object.fromEntries(Object.entries(mine).filter(([name, p]) => JSON.stringify(p) !== JSON.stringify(there[name])));
  if (!drop.length && !count(put)) return;
  if (!about.track) {
    if ([...clicks].some(([frame, one]) => frame !== marked && count(one) > count(mine))) return;   // until there are as many
    clicks.clear();
  }
  clicks.set(marked, mine);
  post("mark", { film: about.path, robot: about.robot, kind: kind(about.track), frame: marked, put, drop });
}
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
get("track").onclick = tried(async () => { if (!saved) keepMarks(); await send(); if (outbox.every(([, { film }]) => film !== about.path)) { await call("track", asked()); await watch(); } });
get("film").onchange = get("midline").onchange = tried(film);
