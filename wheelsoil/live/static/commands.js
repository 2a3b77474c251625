// The buttons: what was asked for, whether it was sent, and whether the logger has done it.

import { get, write } from "./dom.js";
import { headers } from "./token.js";

const PATIENCE_MS = 5000;
const FORGET_MS = 120000;
const clock = (date) => date.toTimeString().slice(0, 8);
const markKey = (mark) => `${mark.time_utc_s}|${mark.text}`;

export class Commands {
  /** `leaving` says whether the run is good to leave. */
  constructor(leaving) {
    this.leaving = leaving;
    this.snapshot = null;
    this.live = false;
    this.waiting = [];
    get("mark-form").addEventListener("submit", (event) => {
      event.preventDefault();
      this.mark();
    });
    get("start").addEventListener("click", () => this.askStart());
    get("stop").addEventListener("click", () => this.askStop());
    get("start-dialog").addEventListener("close", () => this.answered("start-dialog", () => this.start()));
    get("stop-dialog").addEventListener("close", () => this.answered("stop-dialog", () => this.stop()));
    setInterval(() => this.giveUp(), 500);
  }

  /** Take the newest snapshot, and whether it is one of now. */
  take(snapshot, live) {
    this.snapshot = snapshot;
    this.live = live;
    const marks = snapshot?.marks ?? [];
    for (const mark of marks.filter((each) => !this.seen?.has(markKey(each)))) {
      const asked = this.waiting.find((each) => each.kind === "mark" && (!each.text || mark.text.includes(each.text)));
      if (asked) this.done(asked, `✓ Mark${asked.text ? ` “${asked.text}”` : ""} stands in the file (${asked.at}).`);
    }
    this.seen = new Set(marks.map(markKey));
    for (const asked of this.waiting.filter((each) => each.kind === "start")) {
      const begun = snapshot?.state === "recording" && `${snapshot.run.id}|${snapshot.run.file}` !== asked.before;
      if (begun) this.done(asked, `✓ Run ${snapshot.run.id} is being recorded.`);
    }
    for (const asked of this.waiting.filter((each) => each.kind === "stop")) {
      if (snapshot?.state === "between") this.done(asked, "✓ The run has ended. Recording goes on, between runs.");
    }
    const busy = (kind) => this.waiting.some((each) => each.kind === kind && !each.late);
    get("mark").disabled = !live;
    get("start").disabled = !live || busy("start") || snapshot.state === "stopping";
    get("stop").disabled = !live || busy("stop") || snapshot.state !== "recording";
  }

  mark() {
    const text = get("note").value.trim();
    get("note").value = "";
    this.send("mark", text, `Mark${text ? ` “${text}”` : ""}`);
  }

  askStart() {
    const { state, run } = this.snapshot;
    write(get("start-hint"), state === "recording" ? `Run ${run.id} ends then.` : "");
    if (run?.id) get("run-name").value = following(run.id);
    this.open("start-dialog");
    get("run-name").select();
  }

  askStop() {
    write(get("stop-question"), `Stop run ${this.snapshot.run.id}?`);
    write(get("stop-hint"), this.leaving().words);
    this.open("stop-dialog");
  }

  open(dialog) {
    get(dialog).returnValue = "no";
    get(dialog).showModal();
  }

  answered(dialog, then) {
    if (get(dialog).returnValue === "yes") then();
  }

  start() {
    const id = get("run-name").value.trim();
    this.send("start", id, `Start of run ${id}`);
  }

  stop() {
    this.send("stop", "", "Stop of the run");
  }

  async send(kind, text, words) {
    const run = this.snapshot?.run;
    const asked = { kind, text, words, at: clock(new Date()), since: performance.now(), before: `${run?.id}|${run?.file}` };
    this.waiting.push(asked);
    this.tell("sent", `${words} is being sent …`);
    try {
      const answer = await fetch("/command", {
        method: "POST",
        headers: headers({ "Content-Type": "application/json" }),
        body: JSON.stringify({ kind, text }),
        signal: AbortSignal.timeout(PATIENCE_MS),
      });
      if (!answer.ok) throw new Error((await answer.text()).trim() || `answer ${answer.status}`);
      if (this.waiting.includes(asked)) this.tell("sent", `${words} was sent (${asked.at}), waiting for the logger …`);
    } catch (error) {
      if (error.name === "TimeoutError") return; // it may have been sent: a snapshot tells, or giveUp
      const why = error instanceof TypeError ? "no connection" : error.message;
      this.drop(asked, `✕ ${words} was NOT sent: ${why}.`);
    }
  }

  /** A command that is not confirmed in time is reported; it may still be confirmed later. */
  giveUp() {
    const age = (asked) => performance.now() - asked.since;
    this.waiting = this.waiting.filter((each) => age(each) < FORGET_MS);
    for (const asked of this.waiting.filter((each) => !each.late && age(each) > PATIENCE_MS)) {
      asked.late = true;
      this.tell("failed", `✕ ${asked.words} (${asked.at}): the logger has not confirmed it yet.`);
    }
  }

  done(asked, words) {
    this.remove(asked);
    this.tell("done", words);
  }

  drop(asked, words) {
    this.remove(asked);
    this.tell("failed", words);
  }

  remove(asked) {
    this.waiting = this.waiting.filter((each) => each !== asked);
  }

  tell(kind, words) {
    get("feedback").dataset.kind = kind;
    write(get("feedback"), words);
    clearTimeout(this.fading);
    if (kind === "done") this.fading = setTimeout(() => { get("feedback").textContent = ""; }, 8000);
  }
}

/** The name after this one: out-3 after out-2. */
function following(id) {
  const found = /^(.*?)(\d+)$/.exec(id);
  return found ? found[1] + String(Number(found[2]) + 1).padStart(found[2].length, "0") : `${id}-2`;
}
