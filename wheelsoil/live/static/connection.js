// The stream of snapshots: read by fetch, so that the token goes in a header and in no address; opened again for ever.

import { headers } from "./token.js";

const SILENT_MS = 4000; // the server says something each second
const AGAIN_MS = 1000;

/** Calls on.hello, on.snapshot, on.ended, on.refused(status); `state` says how it stands. */
export class Connection {
  constructor(on) {
    this.on = on;
    this.state = "opening"; // opening, open, lost, refused, ended
    this.heardAt = performance.now();
    setInterval(() => this.watch(), 500);
    window.addEventListener("hashchange", () => this.again());
    this.open();
  }

  async open() {
    this.abort = new AbortController();
    this.heardAt = performance.now();
    let ended = false;
    try {
      const answer = await fetch("/events", { headers: headers(), cache: "no-store", signal: this.abort.signal });
      if (answer.status === 401) {
        this.state = "refused";
        this.on.refused();
        return;
      }
      if (!answer.ok) throw new Error(await answer.text());
      this.state = "open";
      ended = await this.read(answer.body.getReader());
    } catch {
      // lost: the state shows it, and it is tried again below
    }
    this.state = ended ? "ended" : "lost";
    this.timer = setTimeout(() => this.open(), ended ? 3 * AGAIN_MS : AGAIN_MS);
  }

  async read(reader) {
    const decoder = new TextDecoder();
    let rest = "", ended = false;
    for (;;) {
      const { done, value } = await reader.read();
      if (done) return ended;
      this.heardAt = performance.now();
      const blocks = (rest + decoder.decode(value, { stream: true })).split("\n\n");
      rest = blocks.pop();
      for (const block of blocks) ended = this.dispatch(block) || ended;
    }
  }

  /** Hand an event on; returns whether it was the last one. */
  dispatch(block) {
    const found = /^event: (\w+)\ndata: (.*)$/s.exec(block);
    if (found) this.on[found[1]]?.(JSON.parse(found[2]));
    return found?.[1] === "ended";
  }

  watch() {
    const waiting = this.state === "open" || this.state === "opening" || this.state === "lost";
    if (waiting && performance.now() - this.heardAt > SILENT_MS) this.abort?.abort();
  }

  again() {
    clearTimeout(this.timer);
    this.abort?.abort();
    if (this.state === "refused") this.open();
  }
}
