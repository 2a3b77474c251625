// The samples of runs: asked for once, kept until the choice changes them.

import { ask, query } from "./api.js";
import { campaignOf, choiceOf, state, tell } from "./store.js";
import { during } from "./talk.js";

const kept = new Map(); // "campaign run" -> { revision, data, asked }
const revisions = new Map();
const key = (campaign, run) => JSON.stringify([campaign, run]);

/** The samples of one run, if they are here. */
export const samplesOf = (place) => kept.get(key(place.campaign, place.run))?.data;

/** All runs on soil of a campaign that are read and used, but for one. */
export function othersOf(campaign, but) {
  return (campaignOf(campaign)?.runs ?? [])
    .filter((run) => run.key !== but && run.state === "ready" && run.on_soil && isUsed(campaign, run))
    .map((run) => ({ campaign, run: run.key }));
}

const isOf = (entry, run) => (!entry.file || entry.file === run.file) && (!entry.id || entry.id === run.id);

/** What the choice says of a run, if anything. */
export const chosenRun = (campaign, run) => (choiceOf(campaign).run ?? []).find((entry) => isOf(entry, run));

/** The choice's entry of a run, made where there is none. */
export function entryOf(choice, run) {
  choice.run ??= [];
  const found = choice.run.find((entry) => isOf(entry, run));
  if (found) return found;
  choice.run.push({ file: run.file, id: run.id, use: true }); // recordings of two folders may bear one name
  return choice.run.at(-1);
}

export const isUsed = (campaign, run) => chosenRun(campaign, run)?.use ?? true;

/** The choice has changed what is used: ask again. */
export function forget(campaign) {
  revisions.set(campaign, (revisions.get(campaign) ?? 0) + 1);
}

/** The places whose samples are wanted now, the most wanted first. */
function wanted() {
  const { a, b } = state;
  const places = a ? [a] : [];
  if (b) places.push(...(b.run === null ? othersOf(b.campaign) : [b]));
  if (a && state.colour !== "none") places.push(...othersOf(a.campaign, a.run));
  return places;
}

const isLookedAt = ({ campaign, run }) => [state.a, state.b].some((each) => each?.campaign === campaign && each.run === run);

/** Ask for what is wanted and not here; old samples stay until new ones come. The faint runs are drawn once all are here. */
export async function load() {
  let faint = false;
  for (const { campaign, run } of wanted()) {
    const revision = revisions.get(campaign) ?? 0, place = key(campaign, run), have = kept.get(place);
    if (campaignOf(campaign)?.runs.find((each) => each.key === run)?.state !== "ready") continue;
    if (have && (have.revision === revision || have.asked === revision)) continue;
    kept.set(place, { revision: -1, ...have, asked: revision });
    const data = await during("fetching samples", ask(query("/api/run", { campaign, run })));
    if (!data) {
      kept.set(place, { revision: -1, ...have });
      break;
    }
    if ((revisions.get(campaign) ?? 0) === revision) kept.set(place, { revision, data });
    if (isLookedAt({ campaign, run })) tell("data");
    else faint = true;
  }
  if (faint) tell("data");
}
