/* ---- of all pages: each has `nudge(dx, dy)`, `undo()`, and to save `file` (its name), `text()`, `problem()` (why it can't
   be saved yet) and `goOn` (what to do with it) ---- */
const get = id => document.getElementById(id);
const safe = name => name.replace(/[&<>"]/g, c => `&#${c.charCodeAt(0)};`);
const clamp = (v, low, high) => Math.min(Math.max(v, low), high);
const round = v => Math.round(v * 100) / 100;
const joined = list => list.length < 2 ? list.join("") : `${list.slice(0, -1).join(", ")} and ${list.at(-1)}`;
let saved = true;
function tell(html) { get("alert").textContent = ""; get("status").innerHTML = html; }
function complain(sentence) {
  get("alert").textContent = sentence;
  get("alert").scrollIntoView({ block: "nearest" });
}
function download() {
  const wrong = problem();
  if (wrong) return complain(wrong + " Nothing was downloaded.");
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text()], { type: "application/json" }));
  link.download = file;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  saved = true;
  tell(`${safe(file)} is downloaded: ${goOn}.`);
}
async function copy() {
  const wrong = problem();
  if (wrong) return complain(wrong + " Nothing was copied.");
  try {
    await navigator.clipboard.writeText(text());
  } catch {
    get("raw").open = true;
    getSelection().selectAllChildren(get("json"));
    if (!document.execCommand("copy")) return complain("The browser doesn't allow copying: copy the text below.");
  }
  saved = true;
  tell(`Copied: paste it into a file ${safe(file)}.`);
}
get("download").onclick = download;
get("copy").onclick = copy;
get("undo").onclick = undo;
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
function step({ key, shiftKey }) { nudge(...ARROWS[key].map(d => d * (shiftKey ? 5 : 0.5))); }
for (const button of document.querySelectorAll("[data-nudge]"))
  button.onclick = () => nudge(...button.dataset.nudge.split(" ").map(d => d * 0.5));
