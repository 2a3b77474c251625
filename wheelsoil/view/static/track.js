// The track from above, north up, in colours of the slip; the cursor is a dot on it.

import { fixed, has } from "./channels.js";
import { get, write } from "./dom.js";
import { nearest, set, svg, text } from "./drawing.js";
import { setCursor } from "./cursor.js";
import { samplesOf } from "./samples.js";
import { on, state } from "./store.js";

const PAD = 18, CLASSES = [["slip-neg", "braking"], ["slip1", "slip < 0.2"], ["slip2", "0.2 to 0.5"], ["slip3", "> 0.5"]];
let figure, dot, place, planned = false;

export const figureOfTrack = () => figure;
const classOf = (slip) => (slip < 0 ? 0 : slip < 0.2 ? 1 : slip <= 0.5 ? 2 : 3);

function draw() {
  if (planned) return;
  planned = true;
  requestAnimationFrame(() => {
    planned = false;
    drawNow();
  });
}

function drawNow() {
  const data = state.a && samplesOf(state.a), box = get("track"), known = has(data, "east_m") && has(data, "north_m");
  get("track-box").hidden = !known;
  figure = null;
  if (!known) return box.replaceChildren();
  const { east_m: east, north_m: north, slip, time_s: time } = data, width = box.clientWidth, height = box.clientHeight - 24;
  const rows = time.map((_, i) => i).filter((i) => east[i] !== null && north[i] !== null), ends = (values) => [Math.min(...values), Math.max(...values)];
  const [west, last] = ends(rows.map((i) => east[i])), [south, top] = ends(rows.map((i) => north[i]));
  const size = Math.min((width - 2 * PAD) / (last - west || 1), (height - 2 * PAD) / (top - south || 1)), spare = [(width - size * (last - west)) / 2, (height - size * (top - south)) / 2];
  place = (i) => [spare[0] + (east[i] - west) * size, height - spare[1] - (north[i] - south) * size];
  figure = svg("svg", { class: "figure", width, height: height + 24 });
  const paths = ["", "", "", "", ""], inside = state.zoom ? (i) => time[i] >= state.zoom[0] && time[i] <= state.zoom[1] : () => true;
  for (let j = 1; j < rows.length; j++) {
    const [a, b] = [rows[j - 1], rows[j]], known = data.used[b] && slip[b] !== null && inside(b);
    paths[known ? classOf(slip[b]) : 4] += `M${place(a).map((v) => fixedPx(v)).join(" ")}L${place(b).map((v) => fixedPx(v)).join(" ")}`;
  }
  figure.append(svg("path", { class: "track none-known", d: paths[4] }), ...CLASSES.map(([look], i) => svg("path", { class: `track ${look}`, d: paths[i] })));
  const [x, y] = place(rows[0]);
  dot = svg("circle", { class: "at now", r: 5 });
  figure.append(svg("circle", { class: "start", cx: x, cy: y, r: 4.5 }), text("start", x + (x > width - 50 ? -9 : 9), y + 14, { class: "axis", "text-anchor": x > width - 50 ? "end" : "start" }), ...rose(), ...bar(size, width, height), ...key(height), dot);
  box.replaceChildren(figure);
  const way = rows.reduce((sum, i, j) => (j ? sum + Math.hypot(east[i] - east[rows[j - 1]], north[i] - north[rows[j - 1]]) : 0), 0);
  write(get("track-note"), `${fixed(data.distance_m?.findLast((v) => v !== null) ?? way, 1)} m`);
  showCursor();
}

const fixedPx = (value) => Math.round(value * 10) / 10;
const rose = () => [svg("path", { class: "tick", d: "M16 28v-16m-4 5l4-5l4 5" }), text("N", 16, 42, { class: "axis", "text-anchor": "middle" })];

function bar(size, width, height) {
  const metres = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000].findLast((each) => each * size < width / 4) ?? 1, x = width - PAD - metres * size;
  return [svg("path", { class: "tick", d: `M${x} ${height - 12}v4h${metres * size}v-4` }), text(`${metres} m`, x + (metres * size) / 2, height - 16, { class: "axis", "text-anchor": "middle" })];
}

function key(height) {
  let x = 12;
  return CLASSES.flatMap(([look, words]) => {
    const at = x;
    x += 24 + 6.6 * words.length;
    return [svg("rect", { class: look, x: at, y: height + 6, width: 10, height: 10, rx: 2 }), text(words, at + 15, height + 15, { class: "axis" })];
  });
}

function showCursor() {
  const data = state.a && samplesOf(state.a);
  if (!figure || !data) return;
  const i = nearest(data.time_s, state.cursor ?? 0), known = state.cursor !== null && data.east_m[i] !== null && data.north_m[i] !== null && place(i).every(Number.isFinite); // until it is drawn, the line is of the run before
  dot.classList.toggle("none", !known);
  if (known) set(dot, { transform: `translate(${place(i).join(" ")})` });
}

/** The sample whose place is nearest to the pointer. */
function follow(event) {
  const data = samplesOf(state.a);
  if (!figure || !data) return;
  const { x, y } = figure.getBoundingClientRect();
  let best = null, least = 400;
  data.time_s.forEach((time, i) => {
    if (data.east_m[i] === null) return;
    const [px, py] = place(i), far = (px - event.clientX + x) ** 2 + (py - event.clientY + y) ** 2;
    if (far < least) [best, least] = [time, far];
  });
  if (best !== null) setCursor(best);
}

export function setUp() {
  get("track").addEventListener("pointermove", follow);
  new ResizeObserver(draw).observe(get("track"));
  on("picked data zoom list", draw);
  on("cursor", showCursor);
}
