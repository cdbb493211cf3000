(function () {
"use strict";
// Sorts the table of vehicles by the column whose head is pressed. The page is complete without it.
document.querySelectorAll("table.sortable").forEach(function (table) {
  const body = table.tBodies[0];
  Array.from(table.tHead.rows[0].cells).forEach(function (head, column) {
    const button = head.querySelector("button");
    button.disabled = false;
    button.addEventListener("click", function () {
      const down = head.getAttribute("aria-sort") === "ascending";
      const rows = Array.from(body.rows);
      rows.sort(function (a, b) {
        const x = a.cells[column].dataset.key, y = b.cells[column].dataset.key;
        const order = x - y || x.localeCompare(y, undefined, { numeric: true });
        return down ? -order : order;
      });
      table.querySelectorAll("th[aria-sort]").forEach(function (th) { th.removeAttribute("aria-sort"); });
      head.setAttribute("aria-sort", down ? "descending" : "ascending");
      body.replaceChildren.apply(body, rows);
    });
  });
});
}());
