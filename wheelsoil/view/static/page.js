// Puts the page together, and asks the server how things stand.

import * as address from "./address.js";
import { ask } from "./api.js";
import * as choice from "./choice.js";
import * as compare from "./compare.js";
import * as cross from "./cross.js";
import * as cursor from "./cursor.js";
import * as curve from "./curve.js";
import { get } from "./dom.js";
import * as exports from "./export.js";
import * as fit from "./fit.js";
import * as undoing from "./history.js";
import * as keys from "./keys.js";
import * as layout from "./layout.js";
import * as campaigns from "./list.js";
import * as marks from "./marks.js";
import * as model from "./model.js";
import * as rows from "./rows.js";
import * as save from "./save.js";
import * as selection from "./selection.js";
import * as signals from "./signals.js";
import { become, state, tell } from "./store.js";
import { isOpen, setLink, show, tellError } from "./talk.js";
import { takeToken } from "./token.js";
import * as track from "./track.js";
import * as verdict from "./verdict.js";

const BUSY_MS = 1000;
const CALM_MS = 4000;
const PATIENCE_MS = 8000;
let timer;
let seen = "";
let started; // which start of the server it was that answered

const isBusy = () => state.campaigns.some(({ runs, diagnosis }) => diagnosis.state === "running" || runs.some((run) => run.state === "waiting" || run.state === "processing"));

async function poll() {
  clearTimeout(timer);
  try {
    const told = await ask("/api/list", undefined, PATIENCE_MS), words = JSON.stringify(told);
    setLink("open");
    if (words !== seen) {
      seen = words;
      await take(told);
    }
  } catch (error) {
    tellError("the list", error);
  }
  timer = setTimeout(poll, isBusy() || !isOpen() ? BUSY_MS : CALM_MS);
}

async function take(told) {
  const before = state.campaigns, again = started !== undefined && started !== told.started;
  started = told.started;
  if (again && !sameRuns(before, told.campaigns)) {
    state.campaigns = told.campaigns;
    await tellAgain(before, told.campaigns);
    location.reload(); // keys mean other runs now
    return;
  }
  choice.arrive(told.campaigns, again);
  state.remarks = told.remarks ?? [];
  address.arrive();
  show();
  tell("list");
  if (again) await tellAgain(before, told.campaigns);
}

const sameRuns = (before, now) => JSON.stringify(before.map(runsOf)) === JSON.stringify(now.map(runsOf));
const runsOf = ({ key, name, path, runs }) => [key, name, path, runs.map((run) => [run.key, run.id, run.file])];

/** A server that was started again knows nothing of what was chosen here: tell it, unless somebody has chosen since. */
async function tellAgain(before, now) {
  for (const { key, name, path, choice: theirs, chosen } of now) {
    const ours = before.find((each) => each.name === name && each.path === path)?.choice;
    if (ours && !chosen && JSON.stringify(ours) !== JSON.stringify(theirs)) await choice.change(key, (copy) => { become(copy, ours); });
  }
}

for (const each of [rows, cross, track, cursor, selection, choice, marks, campaigns, model, curve, fit, verdict, compare, layout, signals, save, exports, undoing, address, keys]) each.setUp();
get("ask-token").addEventListener("submit", (event) => {
  event.preventDefault();
  takeToken(get("token").value);
});
addEventListener("hashchange", poll);
poll();
