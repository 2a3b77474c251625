// Drawings are SVG in the page. Figures of the appendix (figure.js) are drawn when they come near the window.
const dataOf = (id) => JSON.parse(document.getElementById(id).textContent);

/** The one cursor of the figures on a time axis, and of their map. */
function moveCursor(block, x) {
  for (const { figure } of block.querySelectorAll(".plot")) if (figure.svg) figure.showCursor(x);
  maps.get(block)?.show(x);
}

// A small map beside linked figures: where the chosen run was at the cursor. Who points at it moves the cursor.
class Place {
  constructor(block) {
    this.block = block;
    this.select = block.querySelector("select");
    this.figure = block.querySelector(".place");
    this.svg = this.figure.querySelector("svg");
    this.runs = JSON.parse(block.querySelector(".places").textContent);
    this.svg.addEventListener("pointermove", (event) => this.point(event));
  }
  draw() {
    const run = this.runs[this.select ? this.select.value : Object.keys(this.runs)[0]];
    this.figure.hidden = !run;
    this.run = run;
    if (!run) return;
    const [west, south] = [Math.min(...run.east), Math.min(...run.north)];
    const size = Math.max(Math.max(...run.east) - west, Math.max(...run.north) - south, 1);
    this.points = run.east.map((east, i) => [(100 * (east - west)) / size, (100 * (south - run.north[i])) / size]);
    const [right, top] = [Math.max(...this.points.map(([x]) => x)), Math.min(...this.points.map(([, y]) => y))];
    this.svg.setAttribute("viewBox", `-5 ${top - 5} ${right + 10} ${10 - top}`);
    this.svg.innerHTML = `<polyline class="way" points="${this.points.join(" ")}"/><circle class="start" r="2.4" cx="${this.points[0][0]}" cy="${this.points[0][1]}"/><circle class="here" r="3.2" visibility="hidden"/>`;
    this.figure.querySelector("figcaption").textContent = `${Math.round(size)} m across, north is up`;
  }
  show(x) {
    if (!this.run) return;
    const after = this.run.x.findIndex((t) => t >= x);
    const [px, py] = this.points[after < 0 ? this.points.length - 1 : after];
    set(this.svg.querySelector(".here"), { cx: px, cy: py, visibility: "visible" });
  }
  point({ clientX, clientY }) {
    if (!this.run) return;
    const { x, y } = new DOMPoint(clientX, clientY).matrixTransform(this.svg.getScreenCTM().inverse());
    const away = this.points.map(([px, py]) => (px - x) ** 2 + (py - y) ** 2);
    moveCursor(this.block, this.run.x[away.indexOf(Math.min(...away))]);
  }
}

const maps = new Map();
for (const block of document.querySelectorAll(".figures.placed")) {
  maps.set(block, new Place(block));
  maps.get(block).draw();
}
const near = new IntersectionObserver((entries) => {
  for (const { target, isIntersecting } of entries) {
    if (!isIntersecting) continue;
    near.unobserve(target);
    target.figure.draw();
    target.figure.listen();
    sized.observe(target);
  }
}, { rootMargin: "500px 0px" });
const sized = new ResizeObserver((entries) => {
  for (const { target } of entries) if (target.clientWidth && target.clientWidth !== target.figure.width) target.figure.redraw();
});
for (const div of document.querySelectorAll(".plot")) near.observe(new Figure(div).div);
for (const select of document.querySelectorAll(".figures select")) {
  const block = select.closest(".figures");
  select.addEventListener("change", () => {
    const name = document.createElement("bdi");
    name.textContent = select.value;
    block.querySelector(".chosen").replaceChildren("Shown: ", name);
    for (const { figure } of block.querySelectorAll(".plot")) figure.redraw();
    maps.get(block)?.draw();
  });
}

function csvOf(curves) {
  const cell = (value) => (value === null || value === undefined ? "" : /[",\n]/.test(value) ? `"${String(value).replaceAll('"', '""')}"` : value);
  const rows = [["series", "x", "y", "lower", "upper"]];
  for (const { name, x, y, lower, upper } of curves) {
    if (!Array.isArray(x) || !Array.isArray(y)) continue;
    x.forEach((value, i) => rows.push([name, value, y[i], lower?.[i], upper?.[i]]));
  }
  return rows.map((row) => row.map(cell).join(",")).join("\n") + "\n";
}

function save(text, type, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

document.addEventListener("click", ({ target }) => {
  const kind = target.dataset?.save;
  if (!kind) return;
  const key = target.parentElement.dataset.figure, drawing = document.getElementById(`drawing-${key}`), figure = document.getElementById(`plot-${key}`)?.figure;
  if (kind === "csv") save(csvOf(drawing ? dataOf(`curves-${key}`).curves : figure.traces), "text/csv", `${key}.csv`);
  else save(standalone(drawing ? drawing.querySelector(".wide-svg svg") : figure.svg, target.closest(".card").querySelector("h3, h4, h5").textContent, JOURNAL_MM), "image/svg+xml", `${key}.svg`);
});

// An address with a section in it opens that section; the contents show where the reader is.
function openNamed() {
  const name = decodeURIComponent(location.hash.slice(1)), part = name && document.getElementById(name);
  if (part?.tagName === "DETAILS") {
    part.open = true;
    part.scrollIntoView();
  }
}
window.addEventListener("hashchange", openNamed);
openNamed();
const links = new Map([...document.querySelectorAll("nav a")].map((link) => [link.hash.slice(1), link]));
function markHere() {
  const ids = [...links.keys()];
  const here = ids.findLast((id) => document.getElementById(id).getBoundingClientRect().top <= 80) ?? ids[0];
  for (const [id, link] of links) link.classList.toggle("on", id === here);
}
for (const event of ["scroll", "resize"]) window.addEventListener(event, markHere, { passive: true });
markHere();
