// The model's curve that follows the sliders: one question in flight at a time, always with the newest values.

import { ask, Gone, Locked } from "./api.js";
import { get, write } from "./dom.js";
import { BY_HAND, BY_HAND_B } from "./drawing.js";
import { drawOver } from "./plots.js";
import { state, tell } from "./store.js";
import { tellError } from "./talk.js";

const PATIENCE_MS = 15000;
let asked = null; // the newest wish: { model, since }
let flying = false;
let fitted = [];
let byHand = [];

/** Draw the curve of these values: { sinkage, effects, values, soil, load_n }; `since` is when a slider was moved. */
export function bend(model, since) {
  asked = { model, since };
  if (!flying) fly();
}

/** Curves of fitted models, beside the one by hand. */
export function setFitted(curves) {
  fitted = curves;
  put();
}

function put() {
  state.curves = [...byHand, ...fitted];
  tell("curves");
  drawOver("slip");
}

async function fly() {
  flying = true;
  try {
    while (asked) {
      const { model, since } = asked;
      asked = null;
      await answer(model, since);
    }
  } finally {
    flying = false;
  }
}

async function answer(model, since) {
  const places = [[state.a?.campaign, BY_HAND, model]];
  if (state.b && state.b.campaign !== state.a?.campaign) places.push([state.b.campaign, BY_HAND_B, { ...model, soil: {}, load_n: null }]);
  try {
    const told = await Promise.all(places.filter(([campaign]) => campaign).map(async ([campaign, look, body]) => ({ ...(await ask("/api/curve", { campaign, ...body }, PATIENCE_MS)), ...look, campaign })));
    byHand = told;
    why("");
    tell("load", told[0]?.load_n ?? null);
    put();
    if (since) measured(since, told[0]?.ms);
  } catch (error) {
    if (error instanceof Gone || error instanceof Locked) return tellError("the curve", error);
    if (!error.faults) throw error;
    byHand = [];
    why(error.faults.map(({ what, next_step: next }) => (next ? `${what}: ${next}` : what)).join("; "));
    put();
  }
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
