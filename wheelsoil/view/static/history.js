// Undo and redo of what was chosen: the choice, the sliders, the rows and colours. The views (run, zoom) are the browser's own history.

import { change } from "./choice.js";
import { get } from "./dom.js";
import { setLayout } from "./layout.js";
import { pick } from "./list.js";
import { modelNow, setModel } from "./model.js";
import { become, campaignOf, choiceOf, on, state } from "./store.js";

const SETTLED_MS = 350; // a drag of a slider is one step
const MOST = 200;
let past = [], future = [], now = null, timer = 0, restoring = false;

const snapshot = () => ({ campaign: state.a.campaign, choice: choiceOf(state.a.campaign), model: modelNow(), layout: { rows: state.rows, cross: state.cross, colour: state.colour, part: state.part } });
const same = (p, q) => JSON.stringify(p) === JSON.stringify(q);

function soon() {
  clearTimeout(timer);
  timer = setTimeout(record, SETTLED_MS);
}

/** Remember how it stood before, where it stands otherwise now; another campaign begins where it is. */
function record() {
  clearTimeout(timer);
  if (!state.a || !campaignOf(state.a.campaign) || restoring) return;
  const next = structuredClone(snapshot());
  if (now && now.campaign === next.campaign && !same(now, next)) {
    past = [...past.slice(-MOST), now];
    future = [];
  }
  now = next;
  show();
}

function show() {
  get("undo").disabled = !past.length;
  get("redo").disabled = !future.length;
}

function go(from, to) {
  record();
  const wanted = from.pop();
  if (!wanted) return;
  to.push(now);
  now = wanted;
  restoring = true;
  const run = campaignOf(wanted.campaign)?.runs[0];
  if (wanted.campaign !== state.a.campaign && run) pick({ campaign: wanted.campaign, run: run.key });
  if (!same(choiceOf(wanted.campaign), wanted.choice)) change(wanted.campaign, (copy) => { become(copy, wanted.choice); });
  setModel(wanted.model);
  setLayout(wanted.layout);
  restoring = false;
  show();
}

export const undo = () => go(past, future);
export const redo = () => go(future, past);

export function setUp() {
  get("undo").addEventListener("click", undo);
  get("redo").addEventListener("click", redo);
  on("list picked shown model", soon);
}
