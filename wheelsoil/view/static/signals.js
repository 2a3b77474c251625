// Decoded signals of a run: their names once, their points when a row wants them.

import { ask, query } from "./api.js";
import { on, state, tell } from "./store.js";
import { during } from "./talk.js";

const names = new Map(); // "campaign run" -> [{ name, unit }]
const points = new Map(); // "campaign run name" -> { unit, time_s, values }, or null while it is asked for
const key = ({ campaign, run }, name = "") => JSON.stringify([campaign, run, name]);

export const signalOf = (place, name) => points.get(key(place, name));

export async function askSignal(place, name) {
  const at = key(place, name);
  if (points.has(at)) return;
  points.set(at, null);
  const found = await during(`decoding ${name}`, ask(query("/api/signal", { ...place, name })));
  if (found) points.set(at, found);
  tell("signals");
}

export async function namesOf(place) {
  const at = key(place);
  if (!names.has(at)) {
    const told = await during("decoding the signals", ask(query("/api/signals", place)));
    if (!told) return [];
    names.set(at, told.signals);
  }
  return names.get(at);
}

/** Add a row, or take it away. */
export function toggleRow(key, shown, usual) {
  const rows = state.rows ?? usual;
  state.rows = shown ? [...rows.filter((each) => each !== key), key] : rows.filter((each) => each !== key);
  tell("shown");
}

export function setUp() {
  on("picked", () => { for (const [at, found] of points) if (found === null) points.delete(at); });
}
