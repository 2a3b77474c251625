// What is selected: a stretch of time, a box over slip, or all samples with one reason. Every plot shows the same samples.

import { get, write } from "./dom.js";
import { samplesOf } from "./samples.js";
import { runOf, state, tell, on } from "./store.js";
import { sensible } from "./channels.js";

export function select(selection) {
  state.selection = selection;
  tell("selection");
}

const within = (value, low, high) => value !== null && value >= low && value <= high;

/** The selected samples' indices in a run. */
export function selectedIn(data) {
  const chosen = state.selection;
  if (!chosen || !data) return [];
  const matches = {
    time: (i) => within(data.time_s[i], chosen.from, chosen.to),
    slip: (i) => within(data.slip[i], chosen.from, chosen.to) && (!chosen.channel || (data[chosen.channel] && within(data[chosen.channel][i], chosen.low, chosen.high))),
    reason: (i) => data.reason[i] === chosen.code,
  }[chosen.kind];
  const seen = (i) => data.used[i] || state.leftOut || chosen.kind === "reason";
  return data.time_s.map((_, i) => i).filter((i) => seen(i) && matches(i));
}

/** The time that a sample stands for: half of what is between its neighbours. */
const share = (t, i) => ((t[i + 1] ?? t[i]) - (t[i - 1] ?? t[i])) / 2;

function said() {
  const data = state.a && samplesOf(state.a), run = runOf(state.a);
  if (!state.selection || !data || !run) return "Nothing is selected.";
  const rows = selectedIn(data), seconds = rows.reduce((sum, i) => sum + share(data.time_s, i), 0);
  const slip = rows.map((i) => data.slip[i]).filter((value) => value !== null);
  const pull = rows.map((i) => data.drawbar_pull_n?.[i]).filter((value) => value !== null && value !== undefined);
  const parts = [`${rows.length} of ${data.time_s.length} samples of ${run.id}, ${sensible(seconds, 3)} s`];
  const out = rows.filter((i) => !data.used[i]).length;
  if (out) parts.push(`${out} of them left out`);
  if (slip.length) parts.push(`slip ${sensible(Math.min(...slip), 2)} to ${sensible(Math.max(...slip), 2)}`);
  if (pull.length) parts.push(`mean drawbar pull ${sensible(pull.reduce((sum, value) => sum + value, 0) / pull.length, 3)} N`);
  return `${parts.join(", ")}.`;
}

function show() {
  const chosen = state.selection, time = chosen?.kind === "time", slip = chosen?.kind === "slip";
  const fill = (id, value) => { if (document.activeElement !== get(id)) get(id).value = value; };
  fill("time-from", time ? chosen.from.toFixed(1) : "");
  fill("time-to", time ? chosen.to.toFixed(1) : "");
  fill("slip-from", slip ? chosen.from.toFixed(2) : "");
  fill("slip-to", slip ? chosen.to.toFixed(2) : "");
  get("clear").disabled = !chosen;
  write(get("brush-count"), said());
}

/** Limits that are typed: a missing one is open. */
function typed(kind) {
  const number = (id, open) => (get(id).value === "" ? open : Number(get(id).value));
  const [from, to] = [number(`${kind}-from`, NaN), number(`${kind}-to`, NaN)];
  if (Number.isNaN(from) && Number.isNaN(to)) return select(null);
  const data = samplesOf(state.a), ends = kind === "time" ? [0, data?.time_s.at(-1) ?? 0] : [-1, 1];
  const [low, high] = [Number.isNaN(from) ? ends[0] : from, Number.isNaN(to) ? ends[1] : to];
  select({ kind, from: Math.min(low, high), to: Math.max(low, high) });
}

/** Arrow keys on a plot over time move the stretch, with Shift they stretch it. */
export function arrow(event) {
  const chosen = state.selection, step = { ArrowLeft: -0.5, ArrowRight: 0.5 }[event.key];
  if (!step) return;
  event.preventDefault();
  const { from, to } = chosen?.kind === "time" ? chosen : { from: 0, to: 5 };
  select(event.shiftKey ? { kind: "time", from, to: Math.max(from + 0.5, to + step) } : { kind: "time", from: from + step, to: to + step });
}

export function setUp() {
  for (const kind of ["time", "slip"]) for (const end of ["from", "to"]) get(`${kind}-${end}`).addEventListener("change", () => typed(kind));
  get("clear").addEventListener("click", () => select(null));
  document.addEventListener("keydown", (event) => { if (event.key === "Escape" && state.selection) select(null); });
  for (const topic of ["selection", "data", "picked", "shown"]) on(topic, show);
}
