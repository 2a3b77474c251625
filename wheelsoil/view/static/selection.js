// What is selected: a stretch of time, a box over slip, or all samples with one reason. Every plot shows the same samples.

import { ask, Refused } from "./api.js";
import { get, write } from "./dom.js";
import { samplesOf } from "./samples.js";
import { runOf, state, tell, on } from "./store.js";
import { sensible } from "./channels.js";
import { tellError } from "./talk.js";

const PATIENCE_MS = 15000;
let wish = null; // the newest selection that is to be counted
let counting = false;

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

function said({ samples, of, seconds, left_out: out, slip, drawbar_pull_n: pull }, run) {
  const parts = [`${samples} of ${of} samples of ${run.id}, ${sensible(seconds, 3)} s`];
  if (out) parts.push(`${out} of them excluded`);
  if (slip) parts.push(`slip ${sensible(slip[0], 2)} to ${sensible(slip[1], 2)}`);
  if (pull !== null) parts.push(`mean drawbar pull${out && out < samples ? " of those used" : ""} ${sensible(pull, 3)} N`);
  return `${parts.join(", ")}.`;
}

/** What is drawn are few points of many samples: the server counts them all. One question at a time, with the newest limits. */
async function count() {
  const { a, selection: chosen } = state;
  const limits = chosen && { kind: chosen.kind, ...(chosen.kind === "reason" ? { code: chosen.code } : { low: chosen.from, high: chosen.to }), ...(chosen.channel && { channel: chosen.channel, bottom: chosen.low, top: chosen.high }) };
  wish = limits && a && samplesOf(a) ? { campaign: a.campaign, run: a.run, ...limits, left_out: state.leftOut } : null;
  if (!wish) write(get("brush-count"), "Nothing is selected.");
  if (counting) return;
  counting = true;
  try {
    while (wish) {
      const asked = wish;
      wish = null;
      const words = await counted(asked);
      if (words && !wish && state.selection && state.a?.run === asked.run) write(get("brush-count"), words);
    }
  } finally {
    counting = false;
  }
}

/** What the server says of a selection, in words, or why it refuses; one that fails does not stop the next. */
async function counted(asked) {
  try {
    return said(await ask("/api/selected", asked, PATIENCE_MS), runOf(asked));
  } catch (error) {
    if (error instanceof Refused) return error.message;
    tellError("the selection", error);
    return "";
  }
}

function show() {
  const chosen = state.selection, time = chosen?.kind === "time", slip = chosen?.kind === "slip";
  const fill = (id, value) => { if (document.activeElement !== get(id)) get(id).value = value; };
  fill("time-from", time ? chosen.from.toFixed(1) : "");
  fill("time-to", time ? chosen.to.toFixed(1) : "");
  fill("slip-from", slip ? chosen.from.toFixed(2) : "");
  fill("slip-to", slip ? chosen.to.toFixed(2) : "");
  get("clear").disabled = !chosen;
  get("brush-box").classList.toggle("chosen", Boolean(chosen));
  count();
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
