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

function said({ samples, of, left_out: out, slip, drawbar_pull_n: pull }, run) {
  const parts = [`${samples} of ${of} samples of ${run.id}`];
  if (out) parts.push(`${out} excluded`);
  if (slip) parts.push(`slip ${sensible(slip[0], 2)} to ${sensible(slip[1], 2)}`);
  if (pull !== null) parts.push(`mean pull ${sensible(pull, 3)} N`);
  return parts.join(", ");
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
  const chosen = state.selection, limits = chosen?.kind === "time" || chosen?.kind === "slip", digits = chosen?.kind === "slip" ? 2 : 1;
  const fill = (id, value) => { if (document.activeElement !== get(id)) get(id).value = value; };
  get("bar").hidden = !chosen;
  get("bar").querySelector(".numbers").hidden = !limits;
  if (limits) for (const end of ["from", "to"]) fill(end, chosen[end].toFixed(digits));
  write(get("bar-unit"), chosen?.kind === "slip" ? "slip" : "s");
  count();
}

/** Limits that are typed; the other one stays. */
function typed() {
  const chosen = state.selection, [from, to] = ["from", "to"].map((id) => (get(id).value === "" ? chosen[id] : Number(get(id).value)));
  select({ ...chosen, from: Math.min(from, to), to: Math.max(from, to) });
}

/** Stretch the selection of time by so many seconds; it begins at the cursor. */
export function stretch(by) {
  const at = state.cursor ?? 0, end = samplesOf(state.a)?.time_s.at(-1) ?? 0, chosen = state.selection?.kind === "time" ? state.selection : { kind: "time", from: at, to: at };
  const to = Math.min(end, Math.max(0, chosen.to + by));
  select({ kind: "time", from: Math.min(chosen.from, to), to: Math.max(chosen.from, to) });
}

export function setUp() {
  for (const end of ["from", "to"]) get(end).addEventListener("change", typed);
  get("clear").addEventListener("click", () => select(null));
  on("selection data picked shown", show);
}
