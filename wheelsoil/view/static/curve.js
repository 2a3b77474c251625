// The model's curve that follows the sliders: one question in flight at a time, always with the newest values.

import { ask, Gone, Locked } from "./api.js";
import { get, write } from "./dom.js";
import { BY_HAND, BY_HAND_B } from "./drawing.js";
import { drawOver } from "./plots.js";
import { current, state, tell } from "./store.js";
import { tellError } from "./talk.js";

const PATIENCE_MS = 15000;
const drawn = new Map(); // what was asked for a fitted model -> its curve
let wish = null; // the last one: { model, since, campaign }
let asked = false; // whether it is still to be asked
let flying = false;
let byHand = [];
let fitted = []; // fitted models: { name, label, colour, dash, width, model }

/** Draw the curve of these values: { sinkage, effects, values, soil, load_n }; `since` is when a slider was moved. */
export function bend(model, since) {
  wish = { model, since, campaign: state.a?.campaign };
  asked = true;
  if (!flying) fly();
}

/** Fitted models, whose curves are drawn beside the one by hand, for the same run and load. */
export function setFitted(models) {
  fitted = models;
  if (!models.length) drawn.clear();
  if (wish && wish.campaign === state.a?.campaign) bend(wish.model);
  else put(byHand); // the sliders of another campaign bend its own
}

async function fly() {
  flying = true;
  try {
    while (asked) {
      asked = false;
      await answer(wish.model, wish.since);
    }
  } finally {
    flying = false;
  }
}

async function answer(model, since) {
  const a = state.a, places = [[a, BY_HAND, model]];
  if (state.b && state.b.campaign !== a?.campaign) places.push([state.b, BY_HAND_B, { ...model, soil: {}, load_n: null }]);
  try {
    byHand = await Promise.all(places.filter(([place]) => place).map(async ([place, look, body]) => ({ ...(await curveOf(place, body)), ...look, campaign: place.campaign })));
    why("");
    tell("load", byHand[0]?.load_n ?? null);
    put([...byHand, ...(a ? await fittedOnes(a, model.load_n) : [])]);
    if (since) measured(since, byHand[0]?.ms);
  } catch (error) {
    if (error instanceof Gone || error instanceof Locked) return tellError("the curve", error);
    if (!error.faults) throw error;
    why(wordsOf(error));
    byHand = [];
    put(byHand);
  }
}

const curveOf = ({ campaign, run }, body) => ask("/api/curve", { campaign, run, ...body }, PATIENCE_MS);
const wordsOf = ({ faults }) => faults.map(({ what, next_step: next }) => (next ? `${what}: ${next}` : what)).join("; ");

/** The fitted models' curves, those that can be drawn; each is asked for once a run, load and choice. */
async function fittedOnes(place, load) {
  const found = await Promise.all(fitted.map(async ({ model, ...look }) => {
    const key = JSON.stringify([place, load, current()?.choice, model]);
    try {
      if (!drawn.has(key)) drawn.set(key, await curveOf(place, { ...model, load_n: load }));
    } catch (error) {
      if (error instanceof Gone || error instanceof Locked || !error.faults) throw error;
      why(`${look.label}: ${wordsOf(error)}`);
      return [];
    }
    return [{ ...drawn.get(key), ...look }];
  }));
  return found.flat();
}

function put(curves) {
  state.curves = curves;
  tell("curves");
  drawOver("slip");
}

/** How long it took from the slider to the drawn curve; also in the browser's own list of measures, as "curve". */
function measured(since, serverMs) {
  const end = performance.now();
  performance.measure("curve", { start: since, end });
  write(get("measure"), `curve drawn in ${Math.round(end - since)} ms${serverMs === undefined ? "" : ` (server ${Math.round(serverMs)} ms)`}`);
}

function why(words) {
  get("curve-why").hidden = !words;
  write(get("curve-why"), words);
}
