// What is chosen by hand: thresholds, runs, stretches of time. A change is shown at once, goes to the server, and stands as the server confirms it.

import { ask } from "./api.js";
import { get, write } from "./dom.js";
import { chosenRun, entryOf, forget, load, samplesOf } from "./samples.js";
import { campaignOf, choiceOf, current, edited, on, runOf, state, tell } from "./store.js";
import { during } from "./talk.js";

let last = Promise.resolve();
let refused = 0; // changes that the server did not take

/**
 * Change the choice of a campaign. Changes go to the server one after the other, and stand on the page meanwhile.
 * `edit` changes a copy of the choice, more than once: what it sets is read before, from the event, never from the page.
 */
export async function change(key, edit) {
  edited(campaignOf(key)?.choice ?? {}, [{ edit }]); // one that throws does so here
  const made = { campaign: key, edit };
  state.changes.push(made);
  tell("list");
  last = last.catch(() => {}).then(() => send(made)); // one that failed does not stop those after it
  return last;
}

/** Wait for the changes that are underway; false where the server did not take one of them, which the page reports. */
export async function confirmed() {
  const before = refused;
  await last.catch(() => {});
  return refused === before;
}

async function send(made) {
  const campaign = campaignOf(made.campaign);
  let entry;
  try {
    const body = campaign && { campaign: campaign.key, choice: edited(campaign.choice, [made]) };
    if (body) entry = await during(`applying the choice to ${campaign.name}`, ask("/api/choose", body));
  } finally {
    state.changes = state.changes.filter((each) => each !== made);
  }
  if (entry) return took(entry);
  refused += 1;
  tell("list");
}

/** Take a campaign's entry as the server has it now. */
export function took(entry) {
  arrive(state.campaigns.map((each) => (each.key === entry.key ? entry : each)));
  tell("list");
  load();
}

/** Take what the server says of all campaigns; somebody else may have chosen, too. An answer from before the last choice came late. */
export function arrive(campaigns, anew = false) {
  const before = new Map(state.campaigns.map((each) => [each.key, each]));
  state.campaigns = campaigns.map((each) => (!anew && before.get(each.key)?.chosen > each.chosen ? before.get(each.key) : each));
  for (const { key, choice } of state.campaigns) {
    if (before.has(key) && ofSamples(before.get(key).choice) !== ofSamples(choice)) forget(key);
  }
}

/** The part of a choice that changes which samples are used. */
const ofSamples = ({ run, cutoff_hz: cutoff, min_speed_mps: speed } = {}) => JSON.stringify([run, cutoff, speed]);

const round = (value) => Math.round(value * 100) / 100;

/** What is left of stretches when one is taken out. */
function without(stretches, from, to) {
  return stretches.flatMap(([low, high]) => [[low, Math.min(high, from)], [Math.max(low, to), high]]).filter(([low, high]) => high - low > 0.005);
}

/** Stretches with one more; those that touch become one. */
function joined(stretches, from, to) {
  const touching = stretches.filter(([low, high]) => low <= to && high >= from);
  const rest = stretches.filter((each) => !touching.includes(each));
  return [...rest, [Math.min(from, ...touching.map(([low]) => low)), Math.max(to, ...touching.map(([, high]) => high))]].sort((a, b) => a[0] - b[0]);
}

function cut(edit) {
  const run = runOf(state.a), data = samplesOf(state.a), end = round(data.time_s.at(-1) + 0.05);
  const from = round(Math.max(0, state.selection?.from ?? 0)), to = round(Math.min(end, state.selection?.to ?? end));
  change(state.a.campaign, (choice) => {
    const entry = entryOf(choice, run), keep = edit(entry.keep ?? [[0, end]], from, to);
    delete entry.keep;
    if (keep === null) return;
    if (keep.length) entry.keep = keep;
    else entry.use = false;
  });
}

function showKeep() {
  const run = runOf(state.a), keep = run && chosenRun(state.a.campaign, run)?.keep;
  const time = state.selection?.kind === "time" && Boolean(samplesOf(state.a));
  for (const id of ["keep-only", "leave-out", "zoom", "mark"]) get(id).hidden = !time;
  get("keep-too").hidden = !time || !keep;
  get("keep-all").disabled = !keep;
  get("keep-all").hidden = !keep;
  const words = keep ? `Kept of ${run.id}: ${keep.map(([from, to]) => `${from} to ${to} s`).join(", ")}` : "";
  write(get("kept"), run && chosenRun(state.a.campaign, run)?.use === false ? `${run.id} is not used` : words);
}

const NUMBERS = [["slip-threshold", "slip_threshold"], ["cutoff", "cutoff_hz"], ["min-speed", "min_speed_mps"]];

function showForm() {
  const choice = choiceOf(state.a?.campaign);
  for (const [id, name] of NUMBERS) if (document.activeElement !== get(id)) get(id).value = choice[name] ?? "";
  const channels = choice.channels ?? ["dp"];
  get("fit-dp").checked = channels.includes("dp");
  get("fit-t").checked = channels.includes("t");
  get("soil-prior").checked = choice.soil_prior ?? false;
  const set = NUMBERS.filter(([, name]) => choice[name] !== undefined).length;
  write(get("choice-hint"), `${channels.map((each) => ({ dp: "pull", t: "torque" })[each] ?? each).join(", ")}${set ? `; ${set} set` : ""}`);
}

function set(name, value) {
  if (!state.a) return;
  change(state.a.campaign, (choice) => {
    if (value === null) delete choice[name];
    else choice[name] = value;
  });
}

function setChannels() {
  const channels = [["fit-dp", "dp"], ["fit-t", "t"]].filter(([id]) => get(id).checked).map(([, name]) => name);
  if (!channels.length) showForm();
  else set("channels", channels);
}

export function setUp() {
  for (const [id, name] of NUMBERS) get(id).addEventListener("change", () => set(name, get(id).value === "" ? null : Number(get(id).value)));
  for (const id of ["fit-dp", "fit-t"]) get(id).addEventListener("change", setChannels);
  get("soil-prior").addEventListener("change", () => set("soil_prior", get("soil-prior").checked));
  get("choice-form").addEventListener("submit", (event) => event.preventDefault());
  get("keep-only").addEventListener("click", () => cut((_, from, to) => [[from, to]]));
  get("keep-too").addEventListener("click", () => cut(joined));
  get("leave-out").addEventListener("click", () => cut(without));
  get("keep-all").addEventListener("click", () => cut(() => null));
  on("list picked", showForm);
  on("list picked data selection", showKeep);
}
