// What the page shows now, and who wants to know when it changes.

export const state = {
  campaigns: [],
  remarks: [], // what the server says of what it could not open
  a: null, // { campaign, run }: the run that is looked at
  b: null, // { campaign, run }: the one it is compared with; run is null for all runs of a campaign
  rows: null, // keys of the rows of time histories; null: the usual ones
  cross: { x: "slip", y: "drawbar_pull_n" },
  colour: "density", // how the other runs stand in the cross plot
  leftOut: true,
  part: "driving", // what of the slip the axes hold: driving, all, braking
  zoom: null, // [from, to] in seconds
  cursor: null, // seconds
  selection: null,
  changes: [], // of a choice, that the server has not confirmed yet: { campaign, edit }
  curves: [], // { name, label, look, campaign, slip, drawbar_pull_n, ... }
  predictions: {}, // by the look "model" or "baseline": { key, drawbar_pull_n, ... } at the samples of a
};

const listeners = new Map();

export function on(what, listener) {
  for (const topic of what.split(" ")) listeners.set(topic, [...(listeners.get(topic) ?? []), listener]);
}

/** Topics: list, picked, data, shown, zoom, cursor, selection, curves, prediction, load, parameters, model, diagnosis. */
export function tell(what, ...details) {
  for (const listener of listeners.get(what) ?? []) listener(...details);
}

export const campaignOf = (key) => state.campaigns.find((each) => each.key === key);
export const runOf = (place) => campaignOf(place?.campaign)?.runs.find((each) => each.key === place.run);
export const current = () => campaignOf(state.a?.campaign);

/** What is chosen for a campaign: what the server confirmed, with the changes that it has not confirmed yet. Not to be changed. */
export function choiceOf(key) {
  const confirmed = campaignOf(key)?.choice ?? {}, changes = state.changes.filter((each) => each.campaign === key);
  return changes.length ? edited(confirmed, changes) : confirmed;
}

/** A copy of a choice with changes made to it. */
export function edited(choice, changes) {
  const copy = structuredClone(choice);
  for (const { edit } of changes) edit(copy);
  return copy;
}

/** Have a choice be another one, whole. */
export function become(copy, other) {
  for (const name of Object.keys(copy)) delete copy[name];
  return Object.assign(copy, structuredClone(other));
}
