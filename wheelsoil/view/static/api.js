// Questions to the server: JSON both ways; what it refuses comes as faults.

import { headers } from "./token.js";

const PATIENCE_MS = 120000;

/** The server does not answer at all. */
export class Gone extends Error {}

/** The server wants a token, or another one. */
export class Locked extends Error {}

/** The server says why not; `faults` are {what, where, found, expected, next_step}. */
export class Refused extends Error {
  constructor(faults) {
    super(faults.map((fault) => fault.what).join("; "));
    this.faults = faults;
  }
}

/** Get a path, or post a body to it. */
export async function ask(path, body, patienceMs = PATIENCE_MS) {
  const post = body !== undefined && {
    method: "POST", headers: headers({ "Content-Type": "application/json" }), body: JSON.stringify(body),
  };
  let answer, words;
  try {
    answer = await fetch(path, { cache: "no-store", headers: headers(), signal: AbortSignal.timeout(patienceMs), ...post });
    words = await answer.text();
  } catch (error) {
    throw new Gone(error.message);
  }
  if (answer.status === 401) throw new Locked();
  const told = parsed(words);
  if (answer.ok) return told;
  throw new Refused(told?.faults ?? [{ what: words.trim() || `the server answered ${answer.status}`, where: path }]);
}

export const query = (path, values) => `${path}?${new URLSearchParams(values)}`;

function parsed(words) {
  try { return JSON.parse(words); } catch { return null; }
}
