/* ---- pictures of the film that is shown, `reel`: exact ones from the server, and while it plays those of the browser ---- */
const unpacked = text => new Float32Array(Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer);
const row = (flat, k, m) => Array.from({ length: m }, (_, i) => 2 * (k * m + i)).map(i => flat[i] === flat[i] && i < flat.length && i >= 0 ? [flat[i], flat[i + 1]] : null);
let reel = { first: 0, last: 0, rate: 30 };   // path and address, numbers of its first and last frame, times of all
function load(about, first, last) {
  ({ width, height } = about);
  reel = { path: about.path, address: about.address, large: about.large, times: about.times && unpacked(about.times), first, last, rate: about.fps };
  get("time").max = last - first;
  frame = null;
}
const seconds = n => reel.times ? reel.times[n] - reel.times[reel.first] : (n - reel.first) / reel.rate;
const pictures = new Map();   // those seen last are kept
function picture(n) {
  const key = `${reel.path}\n${n}`;
  if (!reel.path) return Promise.resolve(null);
  if (!pictures.has(key)) pictures.set(key, call("frame", null, { film: reel.path, number: n }).then(({ picture }) => picture));
  for (const old of pictures.keys()) {
    if (pictures.size * width * height < 6e7 || old === key) break;
    pictures.get(old).then(one => one !== frame && one.close(), () => {});
    pictures.delete(old);
  }
  pictures.get(key).catch(() => pictures.delete(key));
  return pictures.get(key);
}
function present(n, got) {
  if (filming && !saved) keepMarks();
  number = n; frame = got;
  get("at").textContent = `${n - reel.first} · ${seconds(n).toFixed(2)} s`;
  if (filming && !playing) seen(); else draw();
}
let goal = null, fetching = false, playing = false;
async function go(n) {  // the newest frame that is asked for comes next; of a large film a small picture near it at first
  goal = n;
  if (fetching) return;
  fetching = true;
  try {
    while (goal !== null) {
      const n = clamp(goal, reel.first, reel.last), { path } = reel;
      goal = null;
      if (reel.large && !pictures.has(`${path}\n${n}`)) {
        const { picture, number } = await call("frame", null, { film: path, number: n, early: 1 });
        if (path === reel.path) present(number, picture);
        if (number !== n) await new Promise(rested => setTimeout(rested, 150));
        if (goal !== null) continue;
      }
      const got = await picture(n);
      if (path !== reel.path) continue;
      if (!playing) get("time").value = n - reel.first;
      present(n, got);
    }
  } finally { fetching = false; }
}

/* ---- playing: the browser decodes, and says which frame it shows; without a film or its decoder, frame by frame ---- */
const player = Object.assign(document.createElement("video"), { muted: true, preload: "auto" });
let begin = 0, rolls = 0;   // the player's time of the film's first frame [s]
async function roll() {
  const from = number < reel.last ? number : reel.first, { address } = reel, own = ++rolls;
  const there = n => begin + reel.times[n] + 0.4 / reel.rate;
  if (!player.src.endsWith(address)) {
    begin = await new Promise((done, failed) => {
      player.requestVideoFrameCallback((now, { mediaTime }) => done(mediaTime));
      player.onerror = failed;
      player.src = address;
    });
  }
  const shown = (now, { mediaTime }) => {
    if (!playing || own !== rolls) return;
    player.requestVideoFrameCallback(shown);
    const time = mediaTime - begin + 0.25 / reel.rate;
    let [n, above] = [0, reel.times.length];
    while (above - n > 1) { const middle = (n + above) >> 1; if (reel.times[middle] > time) above = middle; else n = middle; }
    if (n >= reel.last) player.currentTime = there(reel.first);
    if (n < reel.first || n > reel.last) return;
    get("time").value = n - reel.first;
    present(n, player);
  };
  player.loop = true;
  player.currentTime = there(from);
  await player.play();
  player.requestVideoFrameCallback(shown);
}
function flip() {
  const from = (number - reel.first) % (reel.last - reel.first), begun = performance.now();
  const tick = now => {
    if (!playing) return;
    const n = reel.first + Math.floor(from + Math.max(now - begun, 0) * reel.rate / 1000) % (reel.last - reel.first + 1);
    get("time").value = n - reel.first;
    if (n !== number && !fetching) go(n).catch(error => { complain(error.message); playing = false; });
    for (let i = 1; i < 6; i++) if (reel.path && n + i <= reel.last) picture(n + i).catch(() => {});
    requestAnimationFrame(tick);
  };
  requestAnimationFrame(tick);
}
function pause() {
  playing = false; player.pause();
  get("play").textContent = "▶";
}
get("play").onclick = tried(async () => {
  if (playing) { pause(); return go(number); }   // the picture itself
  if (filming && !about) throw new Error(waits());
  if (filming && !saved) keepMarks();
  playing = true; points = [];
  if (filming) update();
  get("play").textContent = "❚❚";
  if (reel.address && player.requestVideoFrameCallback)
    try { return await roll(); } catch { reel.address = null; player.removeAttribute("src"); }
  if (playing) flip();
});
get("time").oninput = tried(() => { if (playing) pause(); return go(+get("time").value + reel.first); });
