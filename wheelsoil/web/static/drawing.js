// Pieces of a figure of the analyst's page and the report: SVG elements, scales, ticks, lines
// (docs/decisions/plotting.md). Colours are by the tokens.

const NS = "http://www.w3.org/2000/svg";

export function svg(tag, attributes = {}, ...children) {
  const made = document.createElementNS(NS, tag);
  set(made, attributes);
  made.append(...children);
  return made;
}

export function set(element, attributes) {
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
}

export const text = (words, x, y, attributes = {}) => svg("text", { x, y, ...attributes }, words);

/** A linear scale from the data's limits to pixels; `back` is its inverse. */
export function scale([low, high], [from, to]) {
  const slope = (to - from) / (high - low || 1), at = (value) => from + (value - low) * slope;
  return Object.assign(at, { back: (pixel) => low + (pixel - from) / slope, limits: [low, high] });
}

/** Round numbers between two limits, at most so many. */
export function ticks([low, high], most) {
  const rough = (high - low) / Math.max(most, 1), power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((each) => each >= rough * (1 - 1e-9));
  const first = Math.ceil(low / step - 1e-9), count = Math.floor(high / step + 1e-9) - first + 1;
  return Array.from({ length: Math.max(0, count) }, (_, i) => (first + i) * step);
}

/** How a tick is written: with the decimals that its step needs. */
export function tickText(value, step) {
  const digits = Math.max(0, -Math.floor(Math.log10(step || 1) + 1e-9));
  return (Math.abs(value) < step / 1e6 ? 0 : value).toFixed(digits).replace("-", "−").replace(/\B(?=(\d{3})+(?!\d))/g, digits ? "" : "\u202f");
}

const place = (value) => Math.round(value * 10) / 10;

/** A line through points, broken where one is missing; of many points a pixel its least and greatest. */
export function line(x, y, X, Y) {
  let path = "", pen = "M", column = NaN, low = 0, high = 0, first = 0, last = 0, held = 0;
  const crowded = x.length > 4000;
  const flush = () => {
    if (!held) return;
    const points = held === 1 ? [first] : low === high ? [first, last] : [first, Math.min(low, high), Math.max(low, high), last];
    for (const value of points) { path += `${pen}${column} ${place(value)}`; pen = "L"; }
    held = 0;
  };
  for (let i = 0; i < x.length; i++) {
    if (y[i] === null || x[i] === null) { flush(); pen = "M"; continue; }
    const px = X(x[i]), py = Y(y[i]);
    if (!crowded) { path += `${pen}${place(px)} ${place(py)}`; pen = "L"; continue; }
    const at = Math.round(px);
    if (at !== column) { flush(); column = at; low = high = first = py; }
    low = Math.min(low, py);
    high = Math.max(high, py);
    last = py;
    held += 1;
  }
  flush();
  return path;
}

/** The area between two lines, in pieces where a value of either is missing. */
export function area(x, upper, lower, X, Y) {
  const pieces = [[]];
  x.forEach((_, i) => (upper[i] === null || lower[i] === null ? pieces.push([]) : pieces.at(-1).push(i)));
  const edge = (rows, y) => rows.map((i) => `${place(X(x[i]))} ${place(Y(y[i]))}`);
  return pieces.filter((rows) => rows.length > 1).map((rows) => `M${[...edge(rows, upper), ...edge(rows.toReversed(), lower)].join("L")}z`).join("");
}

/** Dots: strokes of no length with round ends, all in one path. */
export function dots(x, y, X, Y, rows) {
  let path = "";
  for (const i of rows) if (x[i] !== null && y[i] !== null) path += `M${place(X(x[i]))} ${place(Y(y[i]))}h0`;
  return path;
}

/** The index of the value nearest to one, in ascending values. */
export function nearest(values, wanted) {
  let low = 0, high = values.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (values[middle] < wanted) low = middle; else high = middle;
  }
  return wanted - values[low] <= values[high] - wanted ? low : high;
}

/** A sample of a line, for a legend or beside a value. */
export const sample = (look, x, y, width = 16) => svg("path", { class: look, d: `M${x} ${y}h${width}` });

const KEPT = ["fill", "stroke", "stroke-width", "stroke-dasharray", "stroke-linecap", "stroke-linejoin", "opacity", "visibility", "font-family", "font-size", "font-weight", "text-anchor"];

/** A figure as a file of its own: its colours and type written into it; as wide as on the screen, or so many millimetres. */
export function standalone(figure, title, millimetres) {
  const copy = figure.cloneNode(true), mine = [figure, ...figure.querySelectorAll("*")], theirs = [copy, ...copy.querySelectorAll("*")];
  mine.forEach((element, i) => {
    const style = getComputedStyle(element);
    theirs[i].removeAttribute("class");
    for (const name of KEPT) theirs[i].setAttribute(name, style.getPropertyValue(name));
  });
  const box = figure.viewBox.baseVal, { width, height } = box?.width ? box : figure.getBoundingClientRect(), ground = getComputedStyle(document.documentElement).getPropertyValue("--surface").trim();
  const size = millimetres ? { width: `${millimetres}mm`, height: `${((height * millimetres) / width).toFixed(1)}mm` } : { width, height };
  set(copy, { xmlns: NS, ...size, viewBox: `0 0 ${width} ${height}` });
  copy.prepend(svg("title", {}, title), svg("rect", { width: "100%", height: "100%", fill: ground }));
  return new XMLSerializer().serializeToString(copy);
}
