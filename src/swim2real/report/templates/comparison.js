(() => {
  "use strict";
  // what is not known comes last, whichever way it is sorted
  const compared = (a, b, sign) => {
    if (a === b) return 0;
    if (a === null) return 1;
    if (b === null) return -1;
    return sign * (typeof a === "number" && typeof b === "number" ? a - b : String(a).localeCompare(String(b), "en"));
  };
  const valueOf = (cell) => {
    if ("value" in cell.dataset) return cell.dataset.value === "" ? null : Number(cell.dataset.value);
    return cell.textContent.trim();
  };
  for (const table of document.querySelectorAll("table.sortable")) {
    const heads = [...table.tHead.rows[0].cells];
    const body = table.tBodies[0];
    const planned = [...body.rows]; // equal rows stay in the order as planned
    heads.forEach((head, column) => {
      const button = document.createElement("button");
      button.type = "button";
      button.append(...head.childNodes);
      head.append(button);
      button.addEventListener("click", () => {
        const descending = head.getAttribute("aria-sort") === "ascending";
        heads.forEach((other) => other.removeAttribute("aria-sort"));
        head.setAttribute("aria-sort", descending ? "descending" : "ascending");
        const keyed = planned.map((row) => [valueOf(row.cells[column]), row]);
        keyed.sort(([a], [b]) => compared(a, b, descending ? -1 : 1));
        body.append(...keyed.map(([, row]) => row));
      });
    });
  }
})();
