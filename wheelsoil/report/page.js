"use strict";
// Drawings are SVG in the page. Figures of the appendix are drawn when they come near the window.
const JOURNAL = { millimetres: 174, pixels: 658 };
const narrow = window.matchMedia("(max-width: 600px)").matches;
const touch = window.matchMedia("(hover: none)").matches; // there Plotly's buttons would never go, and lie over the title
const dark = window.matchMedia("(prefers-color-scheme: dark)");
const options = { responsive: true, displaylogo: false, displayModeBar: narrow || touch ? false : "hover", modeBarButtons: [["zoom2d", "pan2d", "resetScale2d"]] };
// What the figures' colours become in a dark theme: the token of the same role.
const TOKENS = { "#111111": "--d-measured", "#1a1a1a": "--ink", "#ffffff": "--surface", "#e3e3e3": "--d-grid", "#9a9a9a": "--d-zero", "#555": "--ink-3",
  "#efefef": "--d-dens-1", "#a6a6a6": "--d-dens-5", "rgba(0,0,0,0.13)": "--d-noise", "#dcebf7": "--ph-drive", "#fbe5d3": "--ph-brake", "#eeeeee": "--ph-still",
  "#0b62c4": "--d-model", "#0072B2": "--d-model", "#D55E00": "--d-base", "#CC79A7": "--d-alt", "#009E73": "--d-second", "#6b5a00": "--d-third",
  "#882255": "--d-wine", "#661100": "--d-brown" };

const token = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const dataOf = (id) => JSON.parse(document.getElementById(id).textContent);

function themed(value) {
  if (typeof value === "string") return value in TOKENS ? token(TOKENS[value]) : value;
  if (Array.isArray(value)) return value.length && typeof value[0] === "number" ? value : value.map(themed);
  if (value === null || typeof value !== "object") return value;
  return Object.fromEntries(Object.entries(value).map(([name, part]) => [name, themed(part)]));
}

function specOf(div) {
  const spec = dataOf(div.id.replace(/^plot-/, "data-"));
  if (dark.matches) [spec.data, spec.layout] = [themed(spec.data), themed(spec.layout)];
  if (narrow) {
    spec.layout.margin = { ...spec.layout.margin, l: 52, r: 6 };
    spec.layout.font.size = 11;
    spec.layout.legend.font.size = 10.5;
    for (const axis of ["xaxis", "yaxis"]) if (spec.layout[axis].title) spec.layout[axis].title.font = { size: 11 };
  }
  return spec;
}

class Shown {
  constructor(div) {
    this.div = div;
    this.select = div.closest(".figures").querySelector("select");
    this.spec = null;
  }
  data() {
    const { data, groups } = this.spec;
    const chosen = this.select ? this.select.value : groups.find((group) => group !== "");
    return data.filter((_, i) => ["", undefined, chosen].includes(groups[i]));
  }
  async draw() {
    library ??= unpacked();
    await library;
    this.spec ??= specOf(this.div);
    const linked = this.div.closest("[data-linked]");
    const layout = structuredClone(this.spec.layout);
    if (linked) {
      Object.assign(layout, { hovermode: "x", shapes: [cursorAt(null)] });
      Object.assign(layout.margin, { l: narrow ? 56 : 76 });
      layout.yaxis.automargin = false;
    }
    Plotly.newPlot(this.div, this.data(), layout, options);
    if (linked) link(this.div, linked);
    this.div.style.minHeight = "";
  }
  choose() {
    if (this.div.layout) Plotly.react(this.div, this.data(), this.div.layout, options);
  }
  async svg() {
    if (!this.spec) await this.draw();
    const { height } = this.spec.layout;
    const url = await Plotly.toImage(this.div, { format: "svg", width: JOURNAL.pixels, height });
    const text = decodeURIComponent(url.slice(url.indexOf(",") + 1));
    return text.replace(/<svg ([^>]*?)width="[^"]*" height="[^"]*"/, `<svg $1width="${JOURNAL.millimetres}mm" height="${((height * JOURNAL.millimetres) / JOURNAL.pixels).toFixed(1)}mm"`);
  }
  curves() {
    this.spec ??= specOf(this.div);
    return this.data();
  }
}

const figures = new Map();

// The library that draws them lies packed in the page until the first figure is looked at; the page's policy knows it.
let library = null;
async function unpacked() {
  const packed = Uint8Array.from(atob(document.getElementById("plotly").textContent), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const script = document.createElement("script");
  script.textContent = await new Response(stream).text();
  document.body.append(script);
}

// Figures on one time axis zoom together, and one cursor runs through all of them.
function cursorAt(x) {
  const line = { color: dark.matches ? token("--accent") : "#0b57b0", width: 1.2 };
  return { type: "line", xref: "x", yref: "paper", x0: x ?? 0, x1: x ?? 0, y0: 0, y1: 1, line, visible: x !== null };
}

function link(div, block) {
  const drawnOnes = () => [...block.querySelectorAll(".plot")].filter((one) => one.layout);
  div.on("plotly_relayout", (change) => {
    if (block.zooming || !Object.keys(change).some((name) => name.startsWith("xaxis."))) return;
    const { range, autorange } = div.layout.xaxis;
    const same = autorange ? { "xaxis.autorange": true } : { "xaxis.range": [...range] };
    block.zooming = true;
    Promise.all(drawnOnes().filter((one) => one !== div).map((one) => Plotly.relayout(one, same))).finally(() => { block.zooming = false; });
  });
  div.on("plotly_hover", ({ xvals }) => moveCursor(block, xvals[0]));
}

function moveCursor(block, x) {
  for (const one of block.querySelectorAll(".plot")) if (one.layout) Plotly.relayout(one, { shapes: [cursorAt(x)] });
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
    const here = this.svg.querySelector(".here");
    for (const [name, value] of Object.entries({ cx: px, cy: py, visibility: "visible" })) here.setAttribute(name, value);
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
  for (const entry of entries) {
    if (!entry.isIntersecting) continue;
    near.unobserve(entry.target);
    figures.get(entry.target).draw();
  }
}, { rootMargin: "500px 0px" });
for (const div of document.querySelectorAll(".plot")) {
  figures.set(div, new Shown(div));
  near.observe(div);
}
for (const select of document.querySelectorAll(".figures select")) {
  const block = select.closest(".figures");
  select.addEventListener("change", () => {
    const name = document.createElement("bdi");
    name.textContent = select.value;
    block.querySelector(".chosen").replaceChildren("Shown: ", name);
    for (const div of block.querySelectorAll(".plot")) figures.get(div).choose();
    maps.get(block)?.draw();
  });
}
dark.addEventListener("change", () => {
  for (const shown of figures.values()) {
    if (!shown.spec) continue;
    shown.spec = null;
    shown.draw();
  }
});

// A drawing on its own carries its colours with it.
const STYLED = ["fill", "stroke", "stroke-width", "stroke-dasharray", "stroke-linejoin", "opacity", "font-size", "font-weight", "font-family", "text-anchor"];
function standalone(drawing) {
  const svg = drawing.querySelector(".wide-svg svg");
  const copy = svg.cloneNode(true);
  const parts = [...svg.querySelectorAll("*")];
  [...copy.querySelectorAll("*")].forEach((part, i) => {
    const style = getComputedStyle(parts[i]);
    for (const name of STYLED) part.style.setProperty(name, style.getPropertyValue(name));
  });
  const { width, height } = svg.viewBox.baseVal;
  copy.setAttribute("xmlns", "http://www.w3.org/2000/svg");
  copy.setAttribute("width", `${JOURNAL.millimetres}mm`);
  copy.setAttribute("height", `${((height * JOURNAL.millimetres) / width).toFixed(1)}mm`);
  return new XMLSerializer().serializeToString(copy);
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

document.addEventListener("click", async ({ target }) => {
  const kind = target.dataset?.save;
  if (!kind) return;
  const key = target.parentElement.dataset.figure;
  const drawing = document.getElementById(`drawing-${key}`);
  const shown = drawing ? null : figures.get(document.getElementById(`plot-${key}`));
  if (kind === "csv") save(csvOf(drawing ? dataOf(`curves-${key}`).curves : shown.curves()), "text/csv", `${key}.csv`);
  else save(drawing ? standalone(drawing) : await shown.svg(), "image/svg+xml", `${key}.svg`);
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
