// The model's curve that follows the sliders, over slip and over time: one question in flight at a time, always with the newest values.

import { ask, Gone, Locked } from "./api.js";
import { get, write } from "./dom.js";
import { samplesOf } from "./samples.js";
import { choiceOf, current, on, runOf, state, tell } from "./store.js";
import { tellError } from "./talk.js";

const PATIENCE_MS = 15000;
const MOST_KEPT = 60;
const kept = new Map(); // what was asked for a model that stays -> its curve or prediction
let wish = null; // the last one: { model, since, campaign, label }
let asked = false; // whether it is still to be asked
let flying = false;
let predicting = false;
let late = false; // whether a newer prediction is to be asked for
let moving = []; // the curve by hand, and that on the other soil
let fitted = []; // fitted models: { name, label, model }

const BASELINE = { effects: [], values: {}, soil: {} };

/** Draw the curve of these values: { sinkage, effects, values, soil, load_n }; `since` is when a slider was moved. */
export function bend(model, since, label = "model") {
  wish = { model, since, label, campaign: state.a?.campaign };
  asked = true;
  if (!flying) fly();
}

/** Fitted models, whose curves are drawn beside the one by hand, for the same run and load. */
export function setFitted(models) {
  fitted = models;
  if (wish && wish.campaign === state.a?.campaign) bend(wish.model, undefined, wish.label);
  else put(moving); // the sliders of another campaign bend its own
}

async function fly() {
  flying = true;
  try {
    while (asked) {
      asked = false;
      await answer(wish);
    }
  } finally {
    flying = false;
  }
}

async function answer({ model, since, label }) {
  const { a, b } = state;
  if (!a) return;
  const places = [[a, { name: "model", look: "model", label }, model]];
  if (b && b.campaign !== a.campaign) places.push([b, { name: "model there", look: "other", label: "model there" }, { ...model, soil: {}, load_n: null }]);
  try {
    moving = await Promise.all(places.map(async ([place, look, body]) => ({ ...(await curveOf(place, body)), ...look, campaign: place.campaign })));
    why("");
    tell("load", moving[0].load_n);
    put([...state.curves.filter(({ look, campaign }) => campaign === a.campaign && (look === "baseline" || look === "fitted")), ...moving]);
    if (since) measured(since, moving[0].ms);
    put([...(await standing(a, model)), ...moving]);
    predict();
  } catch (error) {
    if (error instanceof Gone || error instanceof Locked) return tellError("the curve", error);
    if (!error.faults) throw error;
    why(wordsOf(error));
    moving = [];
    state.predictions = {};
    put(moving);
    tell("prediction");
  }
}

const curveOf = ({ campaign, run }, body) => ask("/api/curve", { campaign, run, ...body }, PATIENCE_MS);
const wordsOf = ({ faults }) => faults.map(({ what, next_step: next }) => (next ? `${what}: ${next}` : what)).join("; ");

/** The answer to a question that stays the same while the choice and the run do. */
async function once(path, body) {
  const key = JSON.stringify([path, body, choiceOf(body.campaign), current()?.runs.map((run) => run.state)]);
  if (!kept.has(key)) {
    if (kept.size >= MOST_KEPT) kept.delete(kept.keys().next().value);
    kept.set(key, await ask(path, body, PATIENCE_MS));
  }
  return kept.get(key);
}

/** The baseline and the fitted models, those that can be drawn. */
async function standing({ campaign, run }, { load_n: load, sinkage }) {
  const models = [{ name: "baseline", label: "laboratory soil", look: "baseline", model: { ...BASELINE, sinkage } }, ...fitted.map((each) => ({ ...each, look: "fitted" }))];
  const found = await Promise.all(models.map(async ({ model, ...look }) => {
    try {
      return [{ ...(await once("/api/curve", { campaign, run, ...model, load_n: load })), ...look, campaign }];
    } catch (error) {
      if (error instanceof Gone || error instanceof Locked || !error.faults) throw error;
      why(`${look.label}: ${wordsOf(error)}`);
      return [];
    }
  }));
  return found.flat();
}

/** The models at the run's samples, behind the curve; those that came for other samples are dropped. */
async function predict() {
  late = true;
  if (predicting) return;
  predicting = true;
  try {
    while (late) {
      late = false;
      await predictOnce(wish, state.a, state.a && samplesOf(state.a));
    }
  } finally {
    predicting = false;
  }
}

async function predictOnce({ model, label }, a, samples) {
  if (!samples || wish.campaign !== a.campaign) return;
  if (!runOf(a)?.on_soil) { // no soil is fitted to it: its samples stand alone
    state.predictions = {};
    return tell("prediction");
  }
  const refused = (error) => { if (!error.faults && !(error instanceof Gone || error instanceof Locked)) throw error; };
  const found = {
    model: { label, ...(await ask("/api/prediction", { ...a, ...model, load_n: null }, PATIENCE_MS).catch(refused)) },
    baseline: { label: "laboratory soil", ...(await once("/api/prediction", { ...a, ...BASELINE, sinkage: model.sinkage }).catch(refused)) },
  };
  if (state.a !== a || samplesOf(a) !== samples) return;
  state.predictions = Object.fromEntries(Object.entries(found).filter(([, each]) => each.drawbar_pull_n));
  tell("prediction");
}

function put(curves) {
  state.curves = curves;
  tell("curves");
}

/** How long it took from the slider to the drawn curve; also in the browser's own list of measures, as "curve". */
function measured(since, serverMs) {
  const end = performance.now();
  performance.measure("curve", { start: since, end });
  write(get("measure"), `curve in ${Math.round(end - since)} ms${serverMs === undefined ? "" : ` (server ${Math.round(serverMs)} ms)`}`);
}

function why(words) {
  get("curve-why").hidden = !words;
  write(get("curve-why"), words);
}

export function setUp() {
  on("data", () => { if (wish && wish.campaign === state.a?.campaign) bend(wish.model, undefined, wish.label); });
}
