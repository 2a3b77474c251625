// What lies over the samples: curves, the selected samples, segments, what is kept. Drawn as plotly's shapes, because
// those are drawn anew in a millisecond or two, where a trace takes a hundred.

import { B_COLOUR, colour, PICKED, SEGMENTS } from "./drawing.js";
import { chosenRun, samplesOf } from "./samples.js";
import { selectedIn } from "./selection.js";
import { runOf, state } from "./store.js";

const WIDE_ENOUGH = 0.035; // share of the axis that a segment's letter needs

const path = (points, between) => points.map(([x, y]) => `${x},${y}`).join(between);

/** Dots: strokes of no length with round ends (page.css), all in one path. */
const dotted = (points) => points.map(([x, y]) => `M${x},${y}L${x},${y}`).join("");

function dots(points) {
  if (!points.length) return [];
  const shape = (name, width, stroke) => ({ type: "path", path: dotted(points), layer: "above", name, line: { width, color: stroke } });
  return [shape("selected-edge", 9, colour("ink")), shape("selected", 5.5, PICKED)];
}

function selected(about, over) {
  const places = [state.a, ...(state.b && state.b.run !== null ? [state.b] : [])], points = [];
  for (const place of places) {
    const data = samplesOf(place), y = data?.[about.key], x = over === "time" ? data?.time_s : data?.slip;
    if (y) points.push(...selectedIn(data).filter((i) => x[i] !== null && y[i] !== null).map((i) => [x[i], y[i]]));
  }
  return dots(points);
}

function box(about, over) {
  const chosen = state.selection;
  if (chosen?.kind !== over) return [];
  const high = chosen.channel === about.key;
  return [{
    type: "rect", layer: "above", name: "box", x0: chosen.from, x1: chosen.to, yref: high ? "y" : "paper",
    y0: high ? chosen.low : 0, y1: high ? chosen.high : 1, line: { color: colour("ink"), width: 1.5, dash: "dot" }, fillcolor: "rgba(240,228,66,0.12)",
  }];
}

function segments(data, span) {
  const shown = (data?.segments ?? []).filter(({ kind }) => kind in SEGMENTS);
  const shapes = shown.map(({ kind, from_s, to_s }) => ({
    type: "rect", layer: "below", name: kind, x0: from_s, x1: to_s, y0: 0, y1: 1, yref: "paper", line: { width: 0 }, fillcolor: SEGMENTS[kind].fill,
  }));
  const letters = shown.filter(({ from_s, to_s }) => to_s - from_s > WIDE_ENOUGH * span).map(({ kind, from_s, to_s }) => ({
    text: SEGMENTS[kind].letter, x: (from_s + to_s) / 2, y: 1, yref: "paper", yanchor: "bottom", showarrow: false, font: { size: 11, color: colour("soft") },
  }));
  return { shapes, letters };
}

/** A bar along the top over what is kept of the run. */
function kept() {
  const run = runOf(state.a), intervals = run && chosenRun(state.a.campaign, run)?.keep;
  return (intervals ?? []).map(([from, to]) => ({
    type: "rect", layer: "above", name: "kept", x0: from, x1: to, y0: 0.975, y1: 1, yref: "paper", line: { width: 0 }, fillcolor: colour("ink"),
  }));
}

function threshold() {
  const at = state.threshold;
  return at === null || at === undefined ? [] : [{ type: "line", layer: "below", name: "threshold", x0: at, x1: at, y0: 0, y1: 1, yref: "paper", line: { color: colour("soft"), width: 1.2, dash: "dash" } }];
}

/** A curve of a model, broken where it has no value. */
function curve({ name, slip, colour: stroke, dash, width, ...values }, about) {
  const y = values[about.key];
  if (!y) return [];
  const pieces = [[]];
  slip.forEach((x, i) => (y[i] === null ? pieces.push([]) : pieces.at(-1).push([x, y[i]])));
  const whole = pieces.filter((piece) => piece.length > 1).map((piece) => `M${path(piece, "L")}`).join("");
  return whole ? [{ type: "path", layer: "above", name: `curve ${name}`, path: whole, line: { color: stroke, dash, width } }] : [];
}

/** Shapes and annotations of one plot, in plotly's words. */
export function overlayOf(about, over) {
  if (over === "slip") {
    const curves = state.curves.flatMap((each) => curve(each, about));
    return { shapes: [...threshold(), ...curves, ...box(about, over), ...selected(about, over)], annotations: [] };
  }
  const data = samplesOf(state.a), { shapes, letters } = segments(data, data?.time_s.at(-1) ?? 1);
  return { shapes: [...shapes, ...kept(), ...box(about, over), ...selected(about, over)], annotations: letters };
}

/** What the lines and marks mean, for the legend: [words, svg attributes of a line or dot]. */
export function legendOf() {
  const line = (stroke, dash, width = 2.5) => ({ kind: "line", stroke, dash, width }), dot = (fill, shape, stroke) => ({ kind: shape, fill, stroke });
  const ink = colour("ink"), soft = colour("soft"), items = [];
  const a = runOf(state.a), b = runOf(state.b);
  if (a) items.push([`${a.id}, used`, dot(ink, "circle")]);
  if (b) items.push([`${b.id}, used`, dot("none", "diamond", B_COLOUR)]);
  if (state.b && state.b.run === null) items.push(["all runs of the other campaign", dot("none", "diamond", B_COLOUR)]);
  if (state.leftOut) items.push(["excluded", dot("none", "cross", soft)]);
  if (state.others) items.push(["other runs", dot(soft, "small")]);
  if (state.selection) items.push(["selected", dot(PICKED, "circle", ink)]);
  for (const each of state.curves) items.push([each.label ?? each.name, line(each.colour, each.dash, each.width)]);
  return items;
}
