// What the page shows now, and who wants to know when it changes.

export const state = {
  campaigns: [],
  remarks: [], // what the server says of what it could not open
  a: null, // { campaign, run }: the run that is looked at
  b: null, // { campaign, run }: the one it is compared with; run is null for all runs of a campaign
  shown: new Set(["drawbar_pull_n", "driving_torque_nm", "sinkage_m"]),
  leftOut: true,
  others: true,
  touchSelects: false, // a finger that drags in a plot selects; else it scrolls the page
  part: "driving", // what the axes over slip hold: driving, all, braking
  selection: null,
  changes: [], // of a choice, that the server has not confirmed yet: { campaign, edit }
  curves: [], // { name, campaign, slip, drawbar_pull_n, ..., colour, dash, width }
};

const listeners = new Map();

export function on(what, listener) {
  listeners.set(what, [...(listeners.get(what) ?? []), listener]);
}

/** Topics: list, picked, data, shown, selection, curves, load, parameters. */
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
