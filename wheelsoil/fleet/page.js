// The table of campaigns: a click on a heading sorts by it, words in the field leave the rows that have all of them.
"use strict";
const table = document.getElementById("table"), body = table.tBodies[0], search = document.getElementById("search");
const headings = [...table.tHead.rows[0].cells], rows = [...body.rows];
const texts = rows.map((row) => row.textContent.toLowerCase());

function valueOf(row, column) {
  const cell = row.cells[column], value = cell.dataset.v;
  if (value === undefined) return cell.textContent;
  return value === "" ? null : Number(value);
}

/** Empty cells come last, whichever way the others go. */
function sort(column) {
  const heading = headings[column], down = heading.getAttribute("aria-sort") === "ascending", sign = down ? -1 : 1;
  for (const each of headings) each.removeAttribute("aria-sort");
  heading.setAttribute("aria-sort", down ? "descending" : "ascending");
  const empty = (value) => value === null || value === "";
  const keyed = [...body.rows].map((row) => [valueOf(row, column), row]);
  keyed.sort(([a], [b]) => empty(a) - empty(b) || sign * (typeof a === "number" ? a - b : a < b ? -1 : a > b ? 1 : 0));
  body.replaceChildren(...keyed.map(([, row]) => row));
}

/** Number of campaigns: one of several wheels has several rows. */
const campaigns = (some) => new Set(some.map((row) => row.dataset.campaign)).size;

function filter() {
  const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
  rows.forEach((row, i) => { row.hidden = !words.every((word) => texts[i].includes(word)); });
  const all = campaigns(rows), shown = campaigns(rows.filter((row) => !row.hidden));
  document.getElementById("count").textContent = words.length ? `${shown} of ${all}` : `${all} campaigns`;
}

headings.forEach((heading, column) => heading.firstElementChild.addEventListener("click", () => sort(column)));
search.addEventListener("input", filter);
filter();
