// Time histories: rows over one axis of time, one cursor through all of them, the values at it in the line of their title.

import { channel, fixed, has, limits, ROWS, scaled } from "./channels.js";
import { get, list, part, write } from "./dom.js";
import { line, nearest, sample, scale, set, svg, text, ticks, tickText } from "./drawing.js";
import { setCursor, stop } from "./cursor.js";
import { marksOf } from "./marks.js";
import { chosenRun, samplesOf } from "./samples.js";
import { select, selectedIn } from "./selection.js";
import { askSignal, signalOf } from "./signals.js";
import { on, runOf, state, tell } from "./store.js";

const LETTERS = { drive: "D", brake: "B", coast: "C", standstill: "S" };
const WORDS = { drive: "driving", brake: "braking", coast: "coasting", standstill: "standstill" };
const TOP = 34, BOTTOM = 36, TITLE = 20, LEAST_ROW = 84, LEFT = 54, RIGHT = 8, SLOT = 72, NAMED = 148, LETTER = 6.3, DRAG_PX = 4;

let X; // scale of time
let drawn = []; // rows that stand: { row, Y, series, values, marks }
let figure, rule, tag, planned = false, drag = null;

/** The rows that are shown, and where a run lacks their channels not. */
export function rowsShown() {
  const data = state.a && samplesOf(state.a), other = state.b?.run && samplesOf(state.b);
  const there = ({ channels }) => channels.some((key) => has(data, key) || has(other, key));
  if (!state.rows) return ROWS.filter((row) => row.usual && there(row));
  return state.rows.map(rowOf).filter((row) => row && (row.signal || there(row)));
}

export function rowOf(key) {
  if (key.startsWith("signal:")) return { key, title: key.slice(7).replace(/^\S* /, ""), signal: key.slice(7), channels: [] };
  return ROWS.find((row) => row.key === key);
}

/** The lines of a row: { name, look, x, y } in the unit that is shown. */
function seriesOf(row, data, other) {
  if (row.signal) {
    askSignal(state.a, row.signal);
    const found = signalOf(state.a, row.signal);
    return { unit: found?.unit ?? "", digits: 3, series: found ? [{ name: "decoded", look: "measured", x: found.time_s, y: found.values }] : [] };
  }
  const about = channel(row.channels[0]), series = [];
  row.channels.map(channel).forEach((each, i) => {
    const look = i ? "second" : "measured", name = each.short ?? "measured", y = scaled(data?.[each.key], each);
    if (!has(data, each.key)) return;
    if (state.leftOut) series.push({ name: "excluded", look: "excluded", x: data.time_s, y: y.map((value, j) => (data.used[j] && data.used[j - 1] && data.used[j + 1] ? null : value)), quiet: true });
    series.push({ name, look, x: data.time_s, y: y.map((value, j) => (data.used[j] ? value : null)), whole: y });
  });
  if (has(other, about.key)) series.push({ name: runOf(state.b).id, look: "other", x: other.time_s, y: scaled(other[about.key], about).map((value, j) => (other.used[j] ? value : null)) });
  if (row.modelled) for (const [look, found] of Object.entries(state.predictions)) {
    if (data && found[about.key]?.length === data.time_s.length) series.push({ name: found.label, look, x: data.time_s, y: scaled(found[about.key], about).map((value, j) => (data.used[j] ? value : null)) });
  }
  return { unit: about.unit, digits: about.digits, series };
}

/** Of pull only the part of the slip that is looked at sets the limits: braking is so much steeper. */
function limitsOf(row, series, data) {
  const partial = row.key === "pull" && state.part !== "all" && data?.slip?.some((slip) => slip !== null && (slip > 0) === (state.part === "driving"));
  const seen = partial ? (i) => data.slip[i] !== null && (slip(data, i) > 0) === (state.part === "driving") : () => true;
  const used = series.filter(({ quiet }) => !quiet), drawn = used.some(({ y }) => y.some((value) => value !== null)) ? used : series;
  const values = drawn.flatMap(({ look, y, x }) => (look === "other" || x !== data?.time_s ? y : y.filter((_, i) => seen(i))));
  const [low, high] = limits(values, 0.08);
  return [Math.min(low, low > 0 && low < (high - low) * 0.4 ? 0 : low), high];
}
const slip = (data, i) => data.slip[i];

export function timeLimits() {
  const ends = [state.a, state.b?.run && state.b].filter(Boolean).map((place) => samplesOf(place)?.time_s.at(-1) ?? 0);
  return state.zoom ?? [0, Math.max(1e-3, ...ends)];
}

/** Draw in the next frame; several wishes are one. */
export function draw() {
  get("rows").setAttribute("aria-busy", "true");
  if (planned) return;
  planned = true;
  requestAnimationFrame(() => {
    planned = false;
    drawNow();
    get("rows").setAttribute("aria-busy", "false");
  });
}

function drawNow() {
  const data = state.a && samplesOf(state.a), box = get("rows");
  get("waiting").hidden = Boolean(data);
  for (const id of ["rows", "legend"]) get(id).hidden = !data; // what stands there is of another run
  drawn = [];
  if (!data) return box.replaceChildren();
  const rows = rowsShown(), width = box.clientWidth;
  const height = Math.max(box.clientHeight, TOP + BOTTOM + rows.length * LEAST_ROW), each = (height - TOP - BOTTOM) / Math.max(rows.length, 1);
  X = scale(timeLimits(), [LEFT, width - RIGHT]);
  figure = svg("svg", { class: "figure", width, height });
  figure.append(...phases(data, height), ...heldOut(height), ...selection(height), timeAxis(height));
  const other = state.b?.run ? samplesOf(state.b) : null;
  rows.forEach((row, i) => figure.append(rowFigure(row, data, other, TOP + i * each, each)));
  figure.append(...flags(data, height));
  rule = svg("path", { class: "cursor", d: `M0 ${TOP}V${height - BOTTOM}` });
  tag = svg("g", { class: "cursor-tag" }, svg("rect", { x: -30, y: height - BOTTOM + 2, width: 60, height: 18, rx: 3 }), text("", 0, height - BOTTOM + 15, { "text-anchor": "middle" }));
  figure.append(rule, tag);
  box.replaceChildren(figure);
  showLegend(data);
  showCursor();
}

function phases(data, height) {
  const [from, to] = X.limits, made = [];
  for (const { kind, from_s, to_s } of data.segments) {
    if (!(kind in LETTERS) || to_s < from || from_s > to) continue;
    const x0 = X(Math.max(from, from_s)), x1 = X(Math.min(to, to_s)), words = x1 - x0 > 64 ? WORDS[kind] : x1 - x0 > 12 ? LETTERS[kind] : "";
    made.push(svg("rect", { class: `phase ${kind}`, x: x0, y: TOP, width: x1 - x0, height: height - TOP - BOTTOM }));
    made.push(svg("rect", { class: `phase ${kind} head`, x: x0, y: 4, width: Math.max(0, x1 - x0 - 1), height: 17 }), text(words, (x0 + x1) / 2, 17, { class: "axis", "text-anchor": "middle" }));
  }
  return made;
}

/** A bar under the phases over what is kept of the run. */
function heldOut() {
  const run = runOf(state.a), keep = run && chosenRun(state.a.campaign, run)?.keep, [from, to] = X.limits;
  return (keep ?? []).filter(([a, b]) => b > from && a < to).map(([a, b]) => svg("rect", { class: "kept", x: X(Math.max(a, from)), y: 23, width: X(Math.min(b, to)) - X(Math.max(a, from)), height: 3 }));
}

function selection(height) {
  const chosen = state.selection, [low, high] = X.limits;
  if (chosen?.kind !== "time" || chosen.to < low || chosen.from > high) return [];
  const x0 = X(Math.max(low, chosen.from)), x1 = X(Math.min(high, chosen.to));
  return [svg("rect", { class: "selection", x: x0, y: TOP, width: Math.max(1, x1 - x0), height: height - TOP - BOTTOM })];
}

function rowFigure(row, data, other, top, height) {
  const { unit, digits, series } = seriesOf(row, data, other), right = X(X.limits[1]), y0 = top + height - 6, y1 = top + TITLE;
  const part = row.key === "pull" && state.part !== "all" ? `, ${state.part}` : "", title = `${row.title}${part}${unit ? ` (${unit})` : ""}`;
  const range = limitsOf(row, series, data), Y = scale(range, [y0, y1]), group = svg("g", { class: "row", "data-row": row.key });
  const marks = ticks(range, (y0 - y1) / 30), step = marks[1] - marks[0] || 1;
  group.append(svg("path", { class: "grid", d: marks.map((value) => `M${LEFT} ${Y(value)}H${right}`).join("") }));
  if (range[0] < 0 && range[1] > 0) group.append(svg("path", { class: "zero", d: `M${LEFT} ${Y(0)}H${right}` }));
  group.append(...marks.map((value) => text(tickText(value, step), LEFT - 6, Y(value) + 4, { class: "axis", "text-anchor": "end" })));
  group.append(text(title, LEFT, top + 13, { class: "title" }));
  const inside = svg("svg", { x: LEFT, y: y1 - 2, width: Math.max(0, right - LEFT), height: y0 - y1 + 4 });
  const lines = series.map(({ name, look, x, y }) => {
    const path = svg("path", { class: look, d: line(x, y, (v) => X(v) - LEFT, (v) => Y(v) - y1 + 2), "data-series": name });
    path.points = { x, y };
    return path;
  });
  inside.append(...lines.filter((path) => !path.classList.contains("measured")).reverse(), ...lines.filter((path) => path.classList.contains("measured")), picked(series, data, Y, y1));
  group.append(inside);
  const said = series.filter(({ quiet }) => !quiet);
  const dots = said.map(({ look }) => svg("circle", { class: `at ${look}`, r: 3.5 })), values = said.map((one, i) => value(one, i, said.length, title, right, top));
  group.append(...dots.toReversed(), ...values.flatMap((each) => each.parts));
  drawn.push({ row, Y, series: said, values, dots, digits });
  return group;
}

/** A value in the line of the title, the first one left; with the name of its line where there is room, without it where there is less. */
function value({ name, look }, i, count, title, right, top) {
  const room = right - LEFT - LETTER * title.length - 12, slot = room >= count * NAMED ? NAMED : SLOT, most = Math.max(1, Math.floor(room / slot));
  const end = right - slot * (Math.min(count, most) - 1 - i) - 2, start = end - slot + 10, isNamed = slot === NAMED;
  const words = text("", isNamed ? end : start + 18, top + 13, { class: "number", "text-anchor": isNamed ? "end" : "start" });
  if (i >= most) return { words, parts: [] };
  const short = name.replace("laboratory", "lab."), label = text(short.length > 11 ? `${short.slice(0, 10)}…` : short, start + 18, top + 13, { class: "label" });
  return { words, parts: [sample(look, start, top + 9, 12), ...(isNamed ? [label] : []), words] };
}

/** The selected samples of the first line, where a box or a reason selected them. */
function picked(series, data, Y, y1) {
  const rows = state.selection && state.selection.kind !== "time" ? selectedIn(data) : [], first = series.find(({ quiet }) => !quiet), y = first?.whole ?? first?.y;
  const path = svg("path", { class: "picked", d: first ? rows.filter((i) => y[i] !== null && y[i] !== undefined && first.x === data.time_s).map((i) => `M${X(first.x[i]) - LEFT} ${Y(y[i]) - y1 + 2}h0`).join("") : "" });
  path.points = { x: rows.map((i) => data.time_s[i]) };
  return path;
}

function timeAxis(height) {
  const marks = ticks(X.limits, (X(X.limits[1]) - LEFT) / 70), step = marks[1] - marks[0] || 1, y = height - BOTTOM;
  const grid = svg("path", { class: "grid", d: marks.map((value) => `M${X(value)} ${TOP}V${y}`).join("") });
  return svg("g", { class: "time-axis" }, grid, ...marks.map((value) => text(tickText(value, step), X(value), y + 15, { class: "axis", "text-anchor": "middle" })), text("Time (s)", X(X.limits[1]), y + 31, { class: "title", "text-anchor": "end" }));
}

function flags(data, height) {
  const [from, to] = X.limits;
  return marksOf(state.a).filter(({ at_s: at }) => at >= from && at <= to).map(({ at_s: at, text: words }) => {
    const x = X(at), shown = words.length > 16 ? `${words.slice(0, 15)}…` : words || "mark", width = 8 + 6.6 * shown.length, side = x + width > X(to) ? -1 : 1;
    const flag = svg("path", { class: "flag", d: `M${x} ${TOP - 12}h${side * width}l${side * -5} 8l${side * 5} 8h${side * -width}z` });
    return svg("g", { class: "mark" }, svg("path", { class: "flag-line", d: `M${x} ${TOP - 12}V${height - BOTTOM}` }), flag, text(shown, x + side * 4, TOP, { class: "flag-text", "text-anchor": side > 0 ? "start" : "end" }), svg("title", {}, `${words} at ${fixed(at, 1)} s`));
  });
}

/** Put the cursor where it is, and say the values there; nothing else is drawn. */
function showCursor() {
  if (!figure || !X) return;
  const [from, to] = X.limits, at = state.cursor, seen = at !== null && at >= from && at <= to;
  figure.classList.toggle("no-cursor", !seen);
  if (!seen) return;
  rule.setAttribute("transform", `translate(${X(at)} 0)`);
  tag.setAttribute("transform", `translate(${Math.max(30, Math.min(X(at), figure.clientWidth - 30))} 0)`);
  tag.lastChild.textContent = `${fixed(at, 2)} s`;
  for (const { Y, series, values, dots, digits } of drawn) {
    series.forEach(({ x, y, whole }, i) => {
      const row = x.length ? nearest(x, at) : -1, value = row < 0 ? null : y[row], said = value ?? whole?.[row] ?? null, inside = value !== null && value !== undefined && Y(value) <= Y(Y.limits[0]) && Y(value) >= Y(Y.limits[1]);
      values[i].words.textContent = fixed(said, digits);
      values[i].words.classList.toggle("faint", value === null);
      dots[i].classList.toggle("none", !inside);
      if (inside) set(dots[i], { transform: `translate(${X(x[row])} ${Y(value)})` });
    });
  }
}

function showLegend(data) {
  const looks = new Map(), shown = new Map(drawn.flatMap(({ series }) => series.map((one) => [one.look, one.name])));
  if (shown.has("measured")) looks.set("measured", "measured");
  for (const look of ["model", "baseline", "other"]) if (shown.has(look)) looks.set(look, shown.get(look));
  if (state.leftOut && data.used.some((used) => !used)) looks.set("excluded", "excluded");
  list(get("legend"), [...looks], () => {
    const item = part("li");
    item.append(svg("svg", { width: 22, height: 8 }, sample("", 1, 4, 20)), part("span"));
    return item;
  }, (item, [look, words]) => {
    item.firstChild.firstChild.setAttribute("class", look);
    write(item.lastChild, words);
  });
}

const timeAt = (event) => {
  const [from, to] = X.limits;
  return Math.min(to, Math.max(from, X.back(event.clientX - figure.getBoundingClientRect().x)));
};

function listen(box) {
  box.addEventListener("pointerdown", (event) => {
    if (event.button || !X || !figure) return;
    stop();
    drag = { x: event.clientX, at: timeAt(event), moved: false };
    setCursor(drag.at);
    if (event.pointerType === "mouse") box.setPointerCapture(event.pointerId);
  });
  box.addEventListener("pointermove", (event) => {
    if (!X || !figure) return;
    const at = timeAt(event);
    if (drag && (drag.moved || Math.abs(event.clientX - drag.x) > DRAG_PX)) {
      drag.moved = true;
      select({ kind: "time", from: Math.min(drag.at, at), to: Math.max(drag.at, at) });
    }
    setCursor(at);
  });
  box.addEventListener("pointerup", () => {
    if (drag && !drag.moved && state.selection) select(null);
    drag = null;
  });
  box.addEventListener("pointercancel", () => { drag = null; });
  box.addEventListener("dblclick", () => zoomTo(null));
  box.addEventListener("wheel", (event) => {
    if (!event.ctrlKey || !X) return;
    event.preventDefault();
    const at = timeAt(event), factor = Math.exp(event.deltaY / 300), [from, to] = X.limits, end = samplesOf(state.a)?.time_s.at(-1) ?? to;
    zoomTo([Math.max(0, at - (at - from) * factor), Math.min(end, at + (to - at) * factor)]);
  }, { passive: false });
}

/** Show a stretch of time in every row, or all of it. */
export function zoomTo(limits) {
  const whole = !limits || limits[1] - limits[0] >= (samplesOf(state.a)?.time_s.at(-1) ?? 0) - 1e-6;
  state.zoom = whole ? null : limits[1] - limits[0] < 0.05 ? state.zoom : [...limits];
  tell("zoom");
}

export const figureOfRows = () => figure;

export function setUp() {
  listen(get("rows"));
  new ResizeObserver(draw).observe(get("rows"));
  on("picked shown data zoom selection prediction signals list", draw);
  on("cursor", showCursor);
}
