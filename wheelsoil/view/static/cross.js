// One channel across another, pull against slip at first: all runs as density or by colour, this run's samples, the models' curves.

import { channel, has, limits, scaled, titleOf, capital, fixed } from "./channels.js";
import { get, list, part, write } from "./dom.js";
import { dots, line, nearest, scale, set, svg, text, ticks, tickText } from "./drawing.js";
import { othersOf, samplesOf } from "./samples.js";
import { select, selectedIn } from "./selection.js";
import { campaignOf, choiceOf, on, runOf, state, tell } from "./store.js";

const LEFT = 54, RIGHT = 12, TOP = 12, BOTTOM = 40, COLUMNS = 44, LINES = 30, SHADES = 5, DRAG_PX = 5, MOST_BY_COLOUR = 3000;
const MODELLED = ["drawbar_pull_n", "driving_torque_nm", "sinkage_m"];
const OF_RUN = { load: ["load_n", 1e-3, "kN"], speed: ["speed_mps", 1, "m/s"], pass: ["pass_number", 1, ""] };
let figure, X, Y, own, dot, pointed, planned = false, drag = null;

export const figureOfCross = () => figure;

export function draw() {
  if (planned) return;
  planned = true;
  requestAnimationFrame(() => {
    planned = false;
    drawNow();
  });
}

const columns = (data, about) => ({ x: scaled(data[about.x.key], about.x), y: scaled(data[about.y.key], about.y) });
const isSlip = () => state.cross.x === "slip";

/** The part of the slip that the axes hold: braking is so much steeper that driving would be flat beside it. */
function seenPart(data) {
  const driven = data?.segments.some(({ kind }) => kind === "drive");
  const part = isSlip() ? (state.part === "driving" && !driven ? "all" : state.part) : "all";
  return { all: () => true, driving: (slip) => slip > 0, braking: (slip) => slip < 0 }[part];
}

/** The least and greatest of the samples that are wanted; null where there is none. */
function reachOf(groups, wanted) {
  let [x0, x1, y0, y1] = [Infinity, -Infinity, Infinity, -Infinity];
  for (const { x, y, used } of groups) {
    for (let i = 0; i < x.length; i++) {
      if (x[i] === null || y[i] === null || !wanted(x[i], y[i], used[i])) continue;
      [x0, x1, y0, y1] = [Math.min(x0, x[i]), Math.max(x1, x[i]), Math.min(y0, y[i]), Math.max(y1, y[i])];
    }
  }
  return x0 > x1 ? null : { x: [x0, x1], y: [y0, y1] };
}

const widened = ([low, high], share) => [low - share * (high - low), high + share * (high - low)];
const isWithin = (value, [low, high]) => value >= low && value <= high;
const isIn = (range, x, y) => isWithin(x, range.x) && isWithin(y, range.y);

/** Limits that hold each used sample of the runs shown, and excluded ones and curves as far as half of that beyond; how many are beyond. */
function limitsOf(groups, curves, seen) {
  const none = { x: [0, 1], y: [0, 1] }, used = reachOf(groups, (x, y, kept) => kept && seen(x)) ?? reachOf(groups, seen) ?? none;
  const near = { x: widened(used.x, 0.5), y: widened(used.y, 0.5) }, all = (state.leftOut && reachOf(groups, (x, y, kept) => seen(x) && (kept || isIn(near, x, y)))) || used;
  const drawn = curves.flatMap(({ x, y }) => y.filter((value, i) => value !== null && seen(x[i]))), [least, greatest] = drawn.length ? limits(drawn) : all.y;
  const ends = ([low, high], margin) => (high > low ? widened([low, high], margin) : [low - 1, high + 1]), [first, last] = ends(all.x, 0.03);
  const y = ends([Math.min(all.y[0], Math.max(near.y[0], least)), Math.max(all.y[1], Math.min(near.y[1], greatest))], 0.07);
  const range = { x: isSlip() && state.part === "driving" ? [0, last] : [first, last], y };
  const isBeyond = (group) => (x, i) => x !== null && group.y[i] !== null && seen(x) && !isIn(range, x, group.y[i]);
  return { ...range, beyond: state.leftOut ? groups.reduce((sum, group) => sum + group.x.filter(isBeyond(group)).length, 0) : 0 };
}

function drawNow() {
  const data = state.a && samplesOf(state.a), box = get("cross"), about = { x: channel(state.cross.x), y: channel(state.cross.y) };
  const title = isSlip() && state.cross.y === "drawbar_pull_n" ? "Pull against slip" : `${capital(about.y.name)} against ${about.x.name}`;
  write(get("cross-title"), title);
  box.setAttribute("aria-label", title);
  box.hidden = !data;
  if (!data || !has(data, about.x.key) || !has(data, about.y.key)) {
    write(get("cross-note"), data ? "not measured" : "");
    figure = null;
    return box.replaceChildren();
  }
  const width = box.clientWidth, height = box.clientHeight, seen = seenPart(data);
  own = { ...columns(data, about), used: data.used };
  const others = (state.colour === "none" ? [] : othersOf(state.a.campaign, state.a.run)).map((place) => ({ place, data: samplesOf(place) })).filter(({ data: each }) => has(each, about.x.key) && has(each, about.y.key));
  const compared = !state.b ? [] : state.b.run === null ? othersOf(state.b.campaign) : [state.b];
  const second = compared.map(samplesOf).filter((each) => has(each, about.x.key) && has(each, about.y.key)).map((each) => ({ ...columns(each, about), used: each.used, data: each }));
  const curves = isSlip() && MODELLED.includes(about.y.key) ? state.curves.filter((each) => each[about.y.key]).map((each) => ({ ...each, x: each.slip, y: scaled(each[about.y.key], about.y) })) : [];
  const groups = others.map(({ place, data: each }) => ({ place, ...columns(each, about), used: each.used })), range = limitsOf([own, ...second, ...groups], curves, seen);
  X = scale(range.x, [LEFT, width - RIGHT]);
  Y = scale(range.y, [height - BOTTOM, TOP + 14]);
  figure = svg("svg", { class: "figure", width, height });
  figure.limits = range;
  figure.append(...axes(about, width, height));
  const inside = svg("svg", { x: LEFT, y: TOP + 8, width: width - LEFT - RIGHT, height: height - BOTTOM - TOP - 4 });
  const px = (value) => X(value) - LEFT, py = (value) => Y(value) - TOP - 8;
  inside.append(...(state.colour === "density" ? density([...groups, own], px, py) : byColour(groups, px, py)));
  for (const each of second) inside.append(svg("path", { class: "samples other", d: dots(each.x, each.y, px, py, rowsOf(each)) }));
  const zoomed = ([from, to]) => (i) => data.time_s[i] >= from && data.time_s[i] <= to;
  const shown = rowsOf(own).filter(state.zoom ? zoomed(state.zoom) : () => true), mine = svg("path", { class: "samples own", d: dots(own.x, own.y, px, py, shown) });
  mine.points = { rows: shown };
  if (state.leftOut) inside.append(svg("path", { class: "samples out", d: [own, ...second, ...groups].map((each) => dots(each.x, each.y, px, py, excludedOf(each))).join("") }));
  inside.append(mine, ...threshold(height, px), ...curves.map((each) => curveOf(each, px, py)));
  const rows = [[own, data], ...second.filter(({ data: each }) => state.b?.run && each).map((each) => [each, each.data])].map(([values, each]) => [values, selectedIn(each)]);
  const chosen = svg("path", { class: "picked", d: rows.map(([values, selected]) => dots(values.x, values.y, px, py, selected)).join("") });
  chosen.points = { count: rows.reduce((sum, [values, selected]) => sum + selected.filter((i) => values.x[i] !== null && values.y[i] !== null).length, 0) };
  inside.append(chosen, ...selectionBox(px, py));
  dot = svg("circle", { class: "at now", r: 5 });
  inside.append(dot);
  pointed = text("", 8, height - BOTTOM + 32, { class: "number" });
  figure.append(inside, pointed);
  box.replaceChildren(figure);
  const load = state.curves[0]?.load_n, note = state.colour === "density" ? "density: all runs" : state.colour === "none" ? "" : `runs by ${state.colour}`;
  write(get("cross-note"), get("cross-note").title = [range.beyond ? `${range.beyond} excluded beyond` : "", note, `points: ${runOf(state.a)?.id ?? ""}`, state.b && `violet: ${runOf(state.b)?.id ?? campaignOf(state.b.campaign)?.name}`, load && curves.length ? `model at ${fixed(load / 1000, 1)} kN` : ""].filter(Boolean).join(" · "));
  showCursor();
}

const rowsOf = ({ x, used }) => x.map((_, i) => i).filter((i) => used[i]);
const excludedOf = ({ x, used }) => x.map((_, i) => i).filter((i) => !used[i]);

function axes(about, width, height) {
  const across = ticks(X.limits, width / 70), up = ticks(Y.limits, height / 50), right = width - RIGHT, low = height - BOTTOM, made = [];
  made.push(svg("path", { class: "grid", d: [...across.map((value) => `M${X(value)} ${TOP + 8}V${low}`), ...up.map((value) => `M${LEFT} ${Y(value)}H${right}`)].join("") }));
  if (Y.limits[0] < 0 && Y.limits[1] > 0) made.push(svg("path", { class: "zero", d: `M${LEFT} ${Y(0)}H${right}` }));
  made.push(...across.map((value) => text(tickText(value, across[1] - across[0]), X(value), low + 15, { class: "axis", "text-anchor": "middle" })));
  made.push(...up.map((value) => text(tickText(value, up[1] - up[0]), LEFT - 6, Y(value) + 4, { class: "axis", "text-anchor": "end" })));
  made.push(text(titleOf(about.y), 8, TOP + 1, { class: "title" }), text(titleOf(about.x), right, low + 32, { class: "title", "text-anchor": "end" }));
  return made;
}

/** Cells by the number of samples in them, in five greys of equal shares. */
function density(groups, px, py) {
  const counts = new Map(), w = (X.limits[1] - X.limits[0]) / COLUMNS, h = (Y.limits[1] - Y.limits[0]) / LINES;
  for (const { x, y, used } of groups) {
    for (let i = 0; i < x.length; i++) {
      if (!used[i] || x[i] === null || y[i] === null) continue;
      const column = Math.floor((x[i] - X.limits[0]) / w), row = Math.floor((y[i] - Y.limits[0]) / h);
      if (column >= 0 && column < COLUMNS && row >= 0 && row < LINES) counts.set(row * COLUMNS + column, (counts.get(row * COLUMNS + column) ?? 0) + 1);
    }
  }
  const most = Math.max(1, ...counts.values()), paths = Array(SHADES).fill("");
  const across = px(X.limits[0] + w) - px(X.limits[0]), up = py(Y.limits[0]) - py(Y.limits[0] + h);
  for (const [cell, count] of counts) {
    const shade = Math.min(SHADES - 1, Math.floor(SHADES * Math.sqrt((count - 1) / most)));
    paths[shade] += `M${px(X.limits[0] + (cell % COLUMNS) * w)} ${py(Y.limits[0] + (Math.floor(cell / COLUMNS) + 1) * h)}h${across + 0.3}v${up + 0.3}h${-across - 0.3}z`;
  }
  return paths.map((d, i) => svg("path", { class: `density d${i + 1}`, d }));
}

/** Groups of the runs by load, speed or pass, at most three, light to dark. */
function byColour(groups, px, py) {
  const [name, factor, unit] = OF_RUN[state.colour] ?? [];
  get("colours").hidden = !name;
  if (!name) return [];
  const known = groups.map((each) => ({ ...each, value: (runOf(each.place)?.[name] ?? NaN) * factor })).filter(({ value }) => Number.isFinite(value));
  const values = [...new Set(known.map(({ value }) => value))].sort((p, q) => p - q), low = values[0], span = values.at(-1) - low || 1;
  const classOf = (value) => Math.min(2, Math.floor((3 * (value - low)) / span)), sets = [[], [], []], step = Math.max(1, Math.ceil(known.reduce((sum, { x }) => sum + x.length, 0) / MOST_BY_COLOUR));
  for (const each of known) sets[classOf(each.value)].push(each);
  const words = (set) => set.map(({ value }) => value), digits = state.colour === "pass" ? 0 : 1;
  const items = sets.map((set, i) => [i, set.length ? [...new Set([Math.min(...words(set)), Math.max(...words(set))].map((value) => fixed(value, digits)))].join(" to ") : ""]).filter(([, said]) => said);
  list(get("colours"), items, () => { const item = part("li"); item.append(part("i"), part("span")); return item; }, (item, [i, said]) => {
    item.firstChild.className = `slip${i + 1}`;
    write(item.lastChild, `${said} ${unit}`.trim());
  });
  return sets.map((set, i) => svg("path", { class: `samples slip${i + 1}`, d: set.map((each) => dots(each.x, each.y, px, py, rowsOf(each).filter((_, j) => j % step === 0))).join("") }));
}

function curveOf({ name, look, x, y }, px, py) {
  const path = svg("path", { class: `curve ${look}`, d: line(x, y, px, py), "data-curve": name });
  path.points = { x, y };
  return path;
}

function threshold(height, px) {
  const at = choiceOf(state.a?.campaign).slip_threshold;
  return at === undefined || !isSlip() ? [] : [svg("path", { class: "threshold", d: `M${px(at)} 0V${height}`, "data-at": at })];
}

function selectionBox(px, py) {
  const chosen = state.selection;
  if (chosen?.kind !== "slip" || !isSlip()) return [];
  const high = chosen.channel === state.cross.y, { factor = 1 } = channel(state.cross.y), top = high ? py(chosen.high * factor) : 0, low = high ? py(chosen.low * factor) : 2000;
  return [svg("rect", { class: "selection", x: px(chosen.from), y: top, width: px(chosen.to) - px(chosen.from), height: low - top })];
}

/** Draw the curves again, and nothing else: a slider moves. */
export function drawCurves() {
  if (!figure || !isSlip()) return;
  const about = channel(state.cross.y);
  for (const each of state.curves) {
    const path = figure.querySelector(`.curve[data-curve="${CSS.escape(each.name)}"]`), y = scaled(each[about.key], about);
    if (!path || !y) { if (y) draw(); continue; }
    path.setAttribute("d", line(each.slip, y, (value) => X(value) - LEFT, (value) => Y(value) - TOP - 8));
    path.points = { x: each.slip, y };
  }
  if (figure.querySelectorAll(".curve").length !== state.curves.filter((each) => each[about.key]).length) draw();
}

function showCursor() {
  const data = state.a && samplesOf(state.a);
  if (!figure || !data) return;
  const i = nearest(data.time_s, state.cursor ?? 0), seen = state.cursor !== null && Number.isFinite(own.x[i]) && Number.isFinite(own.y[i]);
  dot.classList.toggle("none", !seen);
  if (seen) set(dot, { transform: `translate(${X(own.x[i]) - LEFT} ${Y(own.y[i]) - TOP - 8})` });
}

/** What is under the pointer, and the model there, in the line of the axis' title; nothing beside the axes. */
function showPointer([x, y]) {
  const [across, up] = [channel(state.cross.x), channel(state.cross.y)], inside = isWithin(x, X.limits) && isWithin(y, Y.limits);
  const curve = figure.querySelector('.curve[data-curve="model"]')?.points, model = curve?.y[nearest(curve.x, x)];
  const words = [`${across.name} ${fixed(x, across.digits)} ${across.unit}`.trim(), fixed(y, up.digits), Number.isFinite(model) && `model ${fixed(model, up.digits)}`];
  pointed.textContent = inside ? `${words.filter(Boolean).join(" · ")} ${up.unit}` : "";
}

function listen(box) {
  const at = (event) => {
    const place = figure.getBoundingClientRect();
    return [X.back(event.clientX - place.x), Y.back(event.clientY - place.y)];
  };
  box.addEventListener("pointerdown", (event) => {
    if (event.button || !figure || event.pointerType === "touch") return;
    drag = { x: event.clientX, y: event.clientY, at: at(event) };
    box.setPointerCapture(event.pointerId);
  });
  box.addEventListener("pointerleave", () => { if (figure) pointed.textContent = ""; });
  box.addEventListener("pointermove", (event) => {
    if (figure) showPointer(at(event));
    if (!drag || !figure || Math.hypot(event.clientX - drag.x, event.clientY - drag.y) < DRAG_PX) return;
    const [x, y] = at(event), { factor = 1 } = channel(state.cross.y), ends = [drag.at[1] / factor, y / factor].sort((p, q) => p - q);
    if (isSlip()) select({ kind: "slip", from: Math.min(x, drag.at[0]), to: Math.max(x, drag.at[0]), low: ends[0], high: ends[1], channel: state.cross.y });
  });
  for (const end of ["pointerup", "pointercancel"]) box.addEventListener(end, () => { drag = null; });
  box.addEventListener("dblclick", () => {
    state.part = "all";
    tell("shown");
  });
}

export function setUp() {
  listen(get("cross"));
  new ResizeObserver(draw).observe(get("cross"));
  on("picked shown data zoom selection list", draw);
  on("curves", drawCurves);
  on("cursor", showCursor);
}
