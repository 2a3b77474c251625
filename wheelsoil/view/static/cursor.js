// The one cursor: a moment of the run, in every plot. Space plays it.

import { samplesOf } from "./samples.js";
import { on, state, tell } from "./store.js";

let playing = 0; // of requestAnimationFrame
let before = 0;

export function setCursor(at) {
  if (at === state.cursor) return;
  state.cursor = at;
  tell("cursor");
}

const end = () => samplesOf(state.a)?.time_s.at(-1) ?? 0;

/** Move the cursor by so many seconds, within what is shown. */
export function step(by) {
  stop();
  const [from, to] = state.zoom ?? [0, end()];
  setCursor(Math.min(to, Math.max(from, (state.cursor ?? from) + by)));
}

export function stop() {
  cancelAnimationFrame(playing);
  playing = 0;
}

/** Let the cursor run as the run did, or stop it; at the end of what is shown it begins again. */
export function play() {
  if (playing) return stop();
  const [from, to] = state.zoom ?? [0, end()];
  if (state.cursor === null || state.cursor >= to || state.cursor < from) setCursor(from);
  before = performance.now();
  playing = requestAnimationFrame(go);
}

function go(now) {
  const to = state.zoom?.[1] ?? end(), at = state.cursor + (now - before) / 1000;
  before = now;
  setCursor(Math.min(to, at));
  playing = at < to ? requestAnimationFrame(go) : 0;
}

export function setUp() {
  on("picked", stop);
  on("picked data", () => { if (state.cursor === null && end()) setCursor((state.zoom ? state.zoom[0] + state.zoom[1] : end() * 0.8) / 2); });
}
