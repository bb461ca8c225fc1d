/* ---- a picture on which markers are placed: zoomed, moved, enlarged under a lens. The page has `names`, `width`, `height`,
   `places` of the markers on a sketch, `frame` (the picture, of any size), `under(put)`, which draws below the points,
   `ready()`, which says what to do once all are placed, `waits()`, which says why nothing can be placed now, or nothing, and
   `changed()`, called when points have changed. The picture lies on a canvas of its own, below that of the points ---- */
const canvas = document.querySelector("canvas[tabindex]"), context = canvas.getContext("2d");
const below = get("picture").getContext("2d", { alpha: false });
const CLOSEST = 2, HIT = 10, LENS = Math.min(innerWidth, innerHeight) < 620 ? 52 : 75, SLOP = { mouse: 4, pen: 6, touch: 9 };
const touch = matchMedia("(pointer: coarse)").matches;

let points = names.map(() => null);  // [x, y] of the frame, the center of its top-left pixel being (0, 0)
let chosen = -1;   // the point that arrow keys move
let lifted = -1;   // the point that the next click moves
let wanted = -1;   // a marker to place out of order
let history = [], lastStep = "";
let view = { k: 1, x: 0, y: 0 };  // CSS pixels = (frame + 0.5) k + (x, y)
let hover = null;  // where the magnifier looks, in CSS pixels

const toFrame = (x, y) => [(x - view.x) / view.k - 0.5, (y - view.y) / view.k - 0.5];
const toCss = ([x, y]) => [(x + 0.5) * view.k + view.x, (y + 0.5) * view.k + view.y];
const inside = ([x, y]) => x >= -0.5 && y >= -0.5 && x <= width - 0.5 && y <= height - 0.5;
const next = () => (wanted >= 0 && !points[wanted] ? wanted : points.findIndex(p => !p));

/* ---- points ---- */
function remember(step = "") {
  if (!step || step !== lastStep) history.push({ points: points.slice(), chosen, wanted });
  lastStep = step;
  saved = false;
}
const apart = (p, q) => Math.hypot(p[0] - q[0], p[1] - q[1]);
function place(marker, clicked, spot) {
  if (!inside(clicked)) return complain("That is outside of the frame: nothing was placed.");
  remember();
  const put = at => Object.assign(at.map(round), { clicked, spot });
  points[marker] = put(spot);
  // a spot that two clicks find is no dot of either: both stay as they were clicked
  points.forEach((p, i) => {
    if (i === marker || !p?.spot || apart(p.spot, spot) >= CLOSEST) return;
    points[i] = Object.assign(p.clicked.map(round), { clicked: p.clicked, spot });
    points[marker] = put(clicked);
  });
  chosen = marker; lifted = wanted = -1;
  update();
}
function nudge(dx, dy) {
  if (chosen < 0 || !points[chosen]) return complain("There is no point to move yet.");
  remember(`nudge ${chosen}`);
  const [x, y] = points[chosen];
  points[chosen] = [round(clamp(x + dx, -0.5, width - 0.5)), round(clamp(y + dy, -0.5, height - 0.5))];
  hover = null;
  update();
}
function undo() {
  const before = history.pop();
  if (!before) return complain("There is nothing to undo.");
  ({ points, chosen, wanted } = before);
  lifted = -1; lastStep = ""; saved = false;
  update();
}
function clear() {
  if (points.every(p => !p)) return;
  remember();
  points = names.map(() => null);
  chosen = lifted = wanted = -1;
  update();
}
function nearest(at, reach, where = p => p) {
  let best = -1;
  points.forEach((p, i) => {
    const distance = p ? view.k * apart(where(p), toFrame(...at)) : Infinity;
    if (distance <= reach) { best = i; reach = distance; }
  });
  return best;
}
/* ---- the middle of what was clicked: a patch of one color, whose surroundings have another ---- */
const REACHES = [10, 20, 40, 80];  // px from the click; the smallest in which the patch lies is taken
const patch = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
function snapped(at) {
  if (!get("snap").checked || !inside(at)) return at;
  for (const reach of REACHES) {
    const middle = middleOf(at, reach);
    if (middle) return middle;
  }
  return at;
}
function middleOf([cx, cy], reach) {
  const x0 = Math.max(0, Math.round(cx) - reach), x1 = Math.min(width, Math.round(cx) + reach + 1);
  const y0 = Math.max(0, Math.round(cy) - reach), y1 = Math.min(height, Math.round(cy) + reach + 1);
  const w = x1 - x0, h = y1 - y0;
  if (w < 5 || h < 5) return null;
  patch.canvas.width = w; patch.canvas.height = h;
  patch.drawImage(frame, ...part(x0, y0, w, h), 0, 0, w, h);
  const data = patch.getImageData(0, 0, w, h).data, rim = [];
  for (let y = 0; y < h; y++) for (let x = 0; x < w; x++) if (!x || !y || x === w - 1 || y === h - 1) rim.push(y * w + x);
  const median = list => list.sort((a, b) => a - b)[list.length >> 1];
  const around = [0, 1, 2].map(c => median(rim.map(i => data[4 * i + c])));
  const off = i => Math.hypot(...[0, 1, 2].map(c => data[4 * i + c] - around[c]));
  // the pixel that differs most, within some pixels of the screen
  const near = clamp(5 / view.k, 1.5, 6);
  let seed = -1;
  for (let y = 0; y < h; y++) for (let x = 0; x < w; x++)
    if (Math.hypot(x0 + x - cx, y0 + y - cy) <= near && (seed < 0 || off(y * w + x) > off(seed))) seed = y * w + x;
  const noise = median(rim.map(off));
  if (seed < 0 || off(seed) < Math.max(40, 5 * noise)) return null;
  const axis = [0, 1, 2].map(c => (data[4 * seed + c] - around[c]) / off(seed) ** 2);
  const share = i => axis.reduce((sum, a, c) => sum + a * (data[4 * i + c] - around[c]), 0);  // 0 around, 1 of the patch
  const found = new Uint8Array(w * h), waiting = [seed];
  let left = w, right = 0, top = h, bottom = 0, area = 0;
  found[seed] = 1;
  while (waiting.length) {
    const i = waiting.pop(), x = i % w, y = (i - x) / w;
    if (!x || !y || x === w - 1 || y === h - 1) return null;  // it goes on outside
    left = Math.min(left, x); right = Math.max(right, x); top = Math.min(top, y); bottom = Math.max(bottom, y);
    area++;
    for (const j of [i - 1, i + 1, i - w, i + w]) if (!found[j] && share(j) > 0.5) { found[j] = 1; waiting.push(j); }
  }
  const across = right - left + 1, down = bottom - top + 1;
  if (area < 4 || Math.max(across, down) > 2.2 * Math.min(across, down) || area < 0.5 * across * down) return null;  // no dot
  let sum = 0, sx = 0, sy = 0;
  for (let y = top - 1; y <= bottom + 1; y++) for (let x = left - 1; x <= right + 1; x++) {
    const i = y * w + x, part = clamp(share(i), 0, 1);
    if (found[i] || [i - 1, i + 1, i - w, i + w].some(j => found[j])) { sum += part; sx += part * x; sy += part * y; }
  }
  return [x0 + sx / sum, y0 + sy / sum];
}
function click(x, y, exactly) {
  if (waits()) return;
  const at = toFrame(x, y), spot = exactly ? at : snapped(at);
  if (lifted >= 0) return place(lifted, at, spot);
  // while there is something to place, a click beside a point is the next one: neighbors are close
  const marker = next(), hit = marker < 0 ? nearest([x, y], HIT) : nearest([x, y], CLOSEST * view.k, p => p.clicked ?? p);
  if (hit >= 0) { chosen = lifted = hit; return update(); }
  if (marker < 0) return complain(`All ${names.length} are placed: click one to move it.`);
  place(marker, at, spot);
}
/* ---- what is shown ---- */
function update() {
  const marker = waits() ? -1 : next(), name = marker < 0 ? "" : safe(names[marker]);
  if (waits()) tell(waits());
  else if (lifted >= 0) tell(`Moving <b>${safe(names[lifted])}</b>: ${touch ? "tap" : "click"} its new place, or use the arrows.`);
  else if (marker < 0) tell(`All ${names.length} are placed. ${ready()}`);
  else tell(`${touch ? "Tap" : "Click"} <b>${name}</b>${marker === 0 ? ", the first marker at the head" : marker === names.length - 1 ? ", the last one at the tail" : ""}.`
    + (points.some(p => p) ? "" : " Zoom in first, to hit its center."));
  [...get("list").children].forEach(({ firstChild: button }, i) => {
    button.className = [points[i] && "placed", i === marker && lifted < 0 && "next", i === chosen && "chosen"].filter(Boolean).join(" ");
    button.lastChild.textContent = points[i] ? points[i].map(v => v.toFixed(1)).join(", ") : i === marker ? "next" : "–";
    if (i === marker) button.setAttribute("aria-current", "step"); else button.removeAttribute("aria-current");
  });
  changed();
  sketch(lifted >= 0 ? lifted : marker);
  draw();
}
function sketch(marker) {
  const at = i => 22 + 250 * places[i];
  const dots = names.map((_, i) =>
    `<circle class="dot${i === marker ? " next" : points[i] ? " placed" : ""}" cx="${at(i)}" cy="36" r="${i === marker ? 5 : 3.6}"/>`);
  if (marker >= 0) dots.push(dots.splice(marker, 1)[0]);  // above its neighbors
  get("sketch").innerHTML =
    `<path class="hull" d="M4 36 C14 18 90 16 170 26 C205 30 228 33 246 34 L282 22 Q276 36 282 50 L246 38 C228 39 205 42 170 46 C90 56 14 54 4 36Z"/>`
    + dots.join("")
    + (marker >= 0 ? `<text class="next" x="${at(marker)}" y="12" text-anchor="middle">${safe(names[marker])}</text>` : "")
    + (marker !== 0 ? `<text x="4" y="14">head</text>` : "")
    + (marker !== names.length - 1 ? `<text x="296" y="14" text-anchor="end">tail</text>` : "");
}
let planned = false, drawn = {};  // what is on the canvas below
function draw() { if (!planned) { planned = true; requestAnimationFrame(paint); } }
function paint() {
  planned = false;
  const ratio = devicePixelRatio || 1, style = getComputedStyle(document.documentElement);
  const accent = style.getPropertyValue("--accent"), box = [0, 0, ...size()];
  if (frame !== drawn.frame || view !== drawn.view || frame?.tagName === "VIDEO") {
    below.setTransform(ratio, 0, 0, ratio, 0, 0);
    below.fillStyle = style.getPropertyValue("--pool");
    below.fillRect(...box);
    spread(below, view, box, ratio);
    drawn = frame?.complete === false ? {} : { frame, view };
  }
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(...box);
  marks(view, accent);
  lens(...size(), accent, ratio);
  get("scale").textContent = `${Math.round(100 * view.k)} %`;
}
function part(x, y, w, h) {  // of the frame, which may be smaller or larger than it stands for
  const share = (frame.naturalWidth || frame.videoWidth || frame.width) / width;
  return [x * share, y * share, w * share, h * share];
}
function spread(pen, v, [left, top, right, bottom], ratio) {
  pen.imageSmoothingEnabled = v.k * ratio < 3;
  pen.imageSmoothingQuality = frame?.tagName === "VIDEO" ? "low" : "high";
  const x0 = clamp(Math.floor((left - v.x) / v.k), 0, width), x1 = clamp(Math.ceil((right - v.x) / v.k), 0, width);
  const y0 = clamp(Math.floor((top - v.y) / v.k), 0, height), y1 = clamp(Math.ceil((bottom - v.y) / v.k), 0, height);
  if (frame && x1 > x0 && y1 > y0)
    pen.drawImage(frame, ...part(x0, y0, x1 - x0, y1 - y0), v.x + x0 * v.k, v.y + y0 * v.k, (x1 - x0) * v.k, (y1 - y0) * v.k);
}
function marks(v, accent) {
  const put = p => [(p[0] + 0.5) * v.k + v.x, (p[1] + 0.5) * v.k + v.y];
  under(put);
  const line = points.filter(Boolean).map(put);
  context.lineWidth = 1;
  context.setLineDash([4, 4]);
  context.strokeStyle = "#ffffffb0";
  context.beginPath();
  line.forEach(([x, y]) => context.lineTo(x, y));
  context.stroke();
  context.setLineDash([]);
  points.forEach((p, i) => {
    if (!p) return;
    const [x, y] = put(p), r = i === chosen ? 9 : 6;
    for (const [color, line] of [["#000000b0", 4], [i === lifted ? "#ffd54a" : i === chosen ? accent : "#ffffff", 1.75]]) {
      context.strokeStyle = color;
      context.lineWidth = line;
      context.beginPath();
      context.arc(x, y, r, 0, 2 * Math.PI);
      for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
        context.moveTo(x + dx * (r - 3), y + dy * (r - 3));
        context.lineTo(x + dx * (r + 4), y + dy * (r + 4));
      }
      context.stroke();
    }
    const up = i % 2 ? 1 : -1;  // labels above and below by turns, since neighbors are close
    context.font = "600 12px system-ui, sans-serif";
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.lineWidth = 3;
    context.strokeStyle = "#000000c0";
    context.strokeText(names[i], x, y + up * (r + 12));
    context.fillStyle = "#ffffff";
    context.fillText(names[i], x, y + up * (r + 12));
  });
}
function lens(w, h, accent, ratio) {
  const at = hover ?? (chosen >= 0 && points[chosen] ? toCss(points[chosen]) : null);
  const k = Math.max(4 * view.k, 5);
  if (!at || view.k >= 8 || Math.min(w, h) < 4 * LENS) return;
  const [fx, fy] = toFrame(...at);
  if (!inside([fx, fy])) return;
  const left = at[0] > w - 3 * LENS && at[1] < 3 * LENS;
  const cx = left ? LENS + 14 : w - LENS - 14, cy = LENS + 14;
  context.save();
  context.beginPath();
  context.arc(cx, cy, LENS, 0, 2 * Math.PI);
  context.fillStyle = "#000";
  context.fill();
  context.clip();
  const box = [cx - LENS, cy - LENS, cx + LENS, cy + LENS];
  const near = { k, x: cx - (fx + 0.5) * k, y: cy - (fy + 0.5) * k };
  spread(context, near, box, ratio);
  marks(near, accent);
  context.restore();
  for (const [color, width] of [["#000000a0", 3], ["#ffffff", 1]]) {
    context.strokeStyle = color;
    context.lineWidth = width;
    context.beginPath();
    if (hover) for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      context.moveTo(cx + 4 * dx, cy + 4 * dy);
      context.lineTo(cx + 16 * dx, cy + 16 * dy);
    }
    context.moveTo(cx + LENS, cy);
    context.arc(cx, cy, LENS, 0, 2 * Math.PI);
    context.stroke();
  }
}

/* ---- view ---- */
const size = () => [canvas.clientWidth, canvas.clientHeight];
const fitting = () => Math.min(size()[0] / width, size()[1] / height) * 0.98;
function fit() {
  const [w, h] = size(), k = fitting();
  view = { k, x: (w - width * k) / 2, y: (h - height * k) / 2 };
  draw();
}
function look(k, cx, cy, fromX = cx, fromY = cy) {
  // the point of the frame that was at (fromX, fromY) comes to (cx, cy)
  k = clamp(k, Math.min(fitting() * 0.7, 1), 32);
  const ratio = k / view.k, [w, h] = size(), rim = 60;
  view = {
    k,
    x: clamp(cx - (fromX - view.x) * ratio, rim - width * k, w - rim),
    y: clamp(cy - (fromY - view.y) * ratio, rim - height * k, h - rim),
  };
  draw();
}
function zoom(factor, x = size()[0] / 2, y = size()[1] / 2) { look(view.k * factor, x, y); }
function show(p) {
  const [w, h] = size(), [x, y] = toCss(p);
  look(Math.max(view.k, 2 * fitting()), w / 2, h / 2, x, y);
}
let known = [0, 0];
function resize() {
  const [w, h] = size(), ratio = devicePixelRatio || 1;
  for (const layer of [canvas, below.canvas]) { layer.width = Math.round(w * ratio); layer.height = Math.round(h * ratio); }
  if (known[0] === 0) fit();
  else { view = { k: view.k, x: view.x + (w - known[0]) / 2, y: view.y + (h - known[1]) / 2 }; draw(); }
  known = [w, h];
}
resize();
new ResizeObserver(() => { if (size().some((v, i) => v !== known[i])) resize(); }).observe(canvas);

/* ---- pointers ---- */
const pointers = new Map();
let gesture = null;
const local = event => {
  const box = canvas.getBoundingClientRect();
  return [event.clientX - box.left, event.clientY - box.top];
};
function span() {
  const [[ax, ay], [bx, by]] = [...pointers.values()];
  return { x: (ax + bx) / 2, y: (ay + by) / 2, distance: Math.max(Math.hypot(ax - bx, ay - by), 1) };
}
canvas.addEventListener("pointerdown", event => {
  if (event.button > 1) return;
  canvas.focus({ preventScroll: true });
  try { canvas.setPointerCapture(event.pointerId); } catch { /* the pointer is gone already */ }
  const [x, y] = local(event);
  pointers.set(event.pointerId, [x, y]);
  if (pointers.size === 1) {
    const hit = event.button === 1 ? -1 : nearest([x, y], HIT);
    gesture = { kind: event.button === 1 ? "pan" : "click", x, y, hit, lastX: x, lastY: y, from: points[hit] };
  } else {
    gesture = pointers.size === 2 ? { kind: "pinch", ...span() } : { kind: "none" };
  }
  hover = event.pointerType === "touch" ? null : [x, y];
  event.preventDefault();
});
canvas.addEventListener("pointermove", event => {
  const [x, y] = local(event);
  if (event.pointerType !== "touch") { hover = [x, y]; draw(); }
  if (!pointers.has(event.pointerId)) return;
  pointers.set(event.pointerId, [x, y]);
  if (gesture.kind === "pinch" && pointers.size === 2) {
    const now = span();
    look(view.k * now.distance / gesture.distance, now.x, now.y, gesture.x, gesture.y);
    Object.assign(gesture, now);
    return;
  }
  if (gesture.kind === "click" && Math.hypot(x - gesture.x, y - gesture.y) > (SLOP[event.pointerType] ?? 4)) {
    gesture.kind = gesture.hit >= 0 ? "drag" : "pan";
    if (gesture.kind === "drag") { remember(); chosen = gesture.hit; lifted = -1; }
  }
  if (gesture.kind === "pan") look(view.k, x, y, gesture.lastX, gesture.lastY);
  if (gesture.kind === "drag") {
    points[gesture.hit] = [
      round(clamp(gesture.from[0] + (x - gesture.x) / view.k, -0.5, width - 0.5)),
      round(clamp(gesture.from[1] + (y - gesture.y) / view.k, -0.5, height - 0.5)),
    ];
    hover = null;
    update();
  }
  gesture.lastX = x; gesture.lastY = y;
});
function release(event) {
  if (!pointers.delete(event.pointerId)) return;
  if (event.type === "pointerup" && gesture.kind === "click" && !pointers.size) click(gesture.x, gesture.y, event.altKey);
  gesture = pointers.size ? { kind: "none" } : null;
}
canvas.addEventListener("pointerup", release);
canvas.addEventListener("pointercancel", release);
canvas.addEventListener("pointerleave", () => { hover = null; draw(); });
canvas.addEventListener("wheel", event => {
  event.preventDefault();
  const lines = event.deltaMode === 1 ? 20 : 1;
  zoom(Math.exp(-clamp(event.deltaY * lines, -200, 200) * (event.ctrlKey ? 0.01 : 0.002)), ...local(event));
}, { passive: false });

/* ---- keys and buttons ---- */
document.addEventListener("keydown", event => {
  const { key } = event, command = event.ctrlKey || event.metaKey;
  let done = true;
  if (key === "Backspace" || (command && key.toLowerCase() === "z")) undo();
  else if (command || event.altKey) done = false;
  else if (key in ARROWS) step(event);
  else if (key === "+" || key === "=") zoom(1.5);
  else if (key === "-") zoom(1 / 1.5);
  else if (key === "0") fit();
  else if (key === "Escape") { lifted = wanted = -1; update(); }
  else if (key === "Enter" && event.target === canvas) click(size()[0] / 2, size()[1] / 2);
  else done = false;
  if (done) event.preventDefault();
});
get("closer").onclick = () => zoom(1.5);
get("farther").onclick = () => zoom(1 / 1.5);
get("fit").onclick = fit;
get("clear").onclick = clear;
const items = () => names.map((name, i) => {
  const item = document.createElement("li"), button = document.createElement("button");
  button.type = "button";
  button.append(Object.assign(document.createElement("b"), { textContent: name }), document.createElement("span"));
  button.onclick = () => {
    if (points[i]) { chosen = lifted = i; hover = null; show(points[i]); } else { wanted = i; lifted = -1; }
    update();
  };
  item.append(button);
  return item;
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { drawn = {}; draw(); });
