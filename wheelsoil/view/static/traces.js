// A run's samples as plotly's traces. Excluded samples are shown as such, with their reason.

import { axisTitle, has, limits } from "./channels.js";
import { B_COLOUR, colour, layoutOf, words } from "./drawing.js";
import { spaced } from "./dom.js";
import { othersOf, samplesOf } from "./samples.js";
import { runOf, state } from "./store.js";

const MOST_FAINT = 1500;

const looks = () => ({
  a: { colour: colour("ink"), dash: "solid", symbol: "circle", size: 5, opacity: 0.55 },
  b: { colour: B_COLOUR, dash: "dash", symbol: "diamond-open", size: 6, opacity: 0.9 },
});

function hover(place, { name, unit }, over, note = "") {
  const run = words(runOf(place)?.id ?? ""), x = over === "time" ? "%{x:.1f} s" : "slip %{x:.3f}";
  return `${run}<br>${x}<br>${name} %{y:.4~g} ${unit}${note}<extra></extra>`;
}

const only = (values, rows) => values.map((value, i) => (rows(i) ? value : null));

function overTime(place, data, about, look) {
  const y = data[about.key];
  // a line ends at its last used sample; what is excluded begins there, so that neither floats alone
  const out = (i) => !data.used[i] || !data.used[i - 1] || !data.used[i + 1];
  const line = (rows, more) => ({ type: "scatter", mode: "lines", x: data.time_s, y: only(y, rows), connectgaps: false, ...more });
  const traces = [];
  if (state.leftOut || !data.used.some(Boolean)) { // else there would be nothing to see
    traces.push(line(out, { name: "excluded", line: { color: colour("soft"), width: 1, dash: "dot" }, customdata: data.reason.map((code) => words(spaced(code || "used"))), hovertemplate: hover(place, about, "time", "<br>%{customdata}") }));
  }
  traces.push(line((i) => data.used[i], { name: "used", line: { color: look.colour, width: 1.6, dash: look.dash }, hovertemplate: hover(place, about, "time") }));
  return traces;
}

function overSlip(place, data, about, look) {
  const rows = (used) => data.time_s.map((_, i) => i).filter((i) => data.used[i] === used && data.slip[i] !== null && data[about.key][i] !== null);
  const dots = (at, more) => ({ type: "scatter", mode: "markers", x: at.map((i) => data.slip[i]), y: at.map((i) => data[about.key][i]), ...more });
  const traces = [];
  if (state.leftOut) {
    const at = rows(false);
    traces.push(dots(at, { name: "excluded", marker: { color: colour("soft"), symbol: "x-thin-open", size: 5 }, customdata: at.map((i) => [data.time_s[i], words(spaced(data.reason[i]))]), hovertemplate: hover(place, about, "slip", "<br>at %{customdata[0]:.1f} s<br>excluded: %{customdata[1]}") }));
  }
  const at = rows(true);
  traces.push(dots(at, { name: "used", marker: { color: look.colour, symbol: look.symbol, size: look.size, opacity: look.opacity }, customdata: at.map((i) => data.time_s[i]), hovertemplate: hover(place, about, "slip", "<br>at %{customdata:.1f} s") }));
  return traces;
}

/** Runs as one cloud of small dots, thinned. */
function cloud(places, about, marker) {
  const parts = places.map(samplesOf).filter((data) => has(data, about.key));
  const step = Math.max(1, Math.ceil(parts.reduce((sum, data) => sum + data.time_s.length, 0) / MOST_FAINT));
  const x = [], y = [];
  for (const data of parts) {
    for (let i = 0; i < data.slip.length; i += step) {
      if (data.used[i] && data.slip[i] !== null && data[about.key][i] !== null) { x.push(data.slip[i]); y.push(data[about.key][i]); }
    }
  }
  return { type: "scatter", mode: "markers", name: "other runs", x, y, hoverinfo: "skip", marker };
}

/** The part of the slip that the axes hold: braking is so much steeper that driving would be flat beside it. */
function partSeen() {
  const driven = samplesOf(state.a)?.segments.some(({ kind }) => kind === "drive");
  return state.part === "driving" && !driven ? "all" : state.part;
}

/** The part of the slip that is looked at, and what is there: samples, and curves as far as they leave the samples room. */
function slipLimits(traces, { key }) {
  const seen = { all: () => true, driving: (slip) => slip > 0, braking: (slip) => slip < 0 }[partSeen()];
  const points = traces.flatMap((trace) => trace.x.map((slip, i) => [slip, trace.y[i]])).filter(([slip]) => seen(slip));
  const x = limits(points.map(([slip]) => slip), 0.04), [low, high] = limits(points.map(([, y]) => y));
  const curves = state.curves.flatMap((curve) => (curve[key] ?? []).filter((y, i) => y !== null && seen(curve.slip[i])));
  const most = (high - low) / 2, reach = limits(curves);
  return { x, y: curves.length ? [Math.max(low - most, Math.min(low, reach[0])), Math.min(high + most, Math.max(high, reach[1]))] : [low, high] };
}

/** Traces and layout of one plot: a channel over time or over slip. */
export function contentOf(about, over) {
  const { a, b } = state, look = looks(), data = samplesOf(a), other = b && b.run !== null ? samplesOf(b) : null;
  const draw = over === "time" ? overTime : overSlip, traces = [];
  if (over === "slip") {
    if (state.others) traces.push(cloud(othersOf(a.campaign, a.run), about, { color: colour("soft"), size: 3, opacity: 0.35 }));
    if (b && b.run === null) traces.push(cloud(othersOf(b.campaign), about, { color: B_COLOUR, size: 5, symbol: "diamond-open", opacity: 0.8 }));
  }
  if (has(other, about.key)) traces.push(...draw(b, other, about, look.b));
  if (has(data, about.key)) traces.push(...draw(a, data, about, look.a));
  const { x, y } = over === "time" ? { x: [0, Math.max(data?.time_s.at(-1) ?? 1, other?.time_s.at(-1) ?? 0)], y: limits(traces.flatMap((trace) => trace.y)) } : slipLimits(traces, about);
  return { traces, layout: layoutOf(over === "time" ? "time (s)" : { all: "slip", driving: "slip, driven", braking: "slip, braked" }[partSeen()], axisTitle(about), x, y) };
}
