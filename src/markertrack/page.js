/* ---- of all pages: each has `nudge(dx, dy)` and `undo()` ---- */
const get = id => document.getElementById(id);
const safe = name => name.replace(/[&<>"]/g, c => `&#${c.charCodeAt(0)};`);
const clamp = (v, low, high) => Math.min(Math.max(v, low), high);
const round = v => Math.round(v * 100) / 100;
let saved = true;
function tell(html) { get("alert").textContent = ""; get("status").innerHTML = html; }
function complain(sentence) {
  get("alert").textContent = sentence;
  get("alert").scrollIntoView({ block: "nearest" });
}
get("undo").onclick = undo;
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
function step({ key, shiftKey }) { nudge(...ARROWS[key].map(d => d * (shiftKey ? 5 : 0.5))); }
for (const button of document.querySelectorAll("[data-nudge]"))
  button.onclick = () => nudge(...button.dataset.nudge.split(" ").map(d => d * 0.5));
