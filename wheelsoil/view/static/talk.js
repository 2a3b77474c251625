// What is happening, and what went wrong: the status line, the list of faults.

import { Gone, Locked, Refused } from "./api.js";
import { get, list, part, write } from "./dom.js";
import { state } from "./store.js";

const tasks = new Set();
let link = "opening"; // opening, open, lost, locked
let lostAt = 0;
let faults = [];

export const isOpen = () => link === "open";

/** Say whether the server answers. */
export function setLink(now) {
  if (now === "lost" && link !== "lost") lostAt = performance.now();
  link = now;
  show();
}

/** Say on the page what is done, for as long as it takes; what goes wrong becomes a fault and undefined. */
export async function during(words, promise) {
  const task = { words };
  tasks.add(task);
  faults = faults.filter((fault) => fault.task !== words);
  show();
  try {
    return await promise;
  } catch (error) {
    tellError(words, error);
    return undefined;
  } finally {
    tasks.delete(task);
    show();
  }
}

export function tellError(task, error) {
  if (error instanceof Gone) return setLink("lost");
  if (error instanceof Locked) return setLink("locked");
  if (!(error instanceof Refused)) throw error;
  const others = faults.filter((fault) => fault.task !== task), words = ({ what, where }) => JSON.stringify([what, where]);
  const news = error.faults.filter((fault) => !others.some((other) => words(other) === words(fault))); // two askers, one fault
  faults = [...others, ...news.map((fault) => ({ ...fault, task }))];
  show();
}

function say(level, word, headline, spoken = headline) {
  const lost = link === "lost" || link === "locked";
  get("status").dataset.level = level;
  write(get("state"), word);
  write(get("headline"), headline);
  write(get("spoken"), `${word}: ${spoken}`);
  get("alert").hidden = !lost;
  write(get("alert"), lost ? `${word}: ${headline}` : "");
}

export function show() {
  showFaults();
  get("ask-token").hidden = link !== "locked";
  get("main").hidden = link === "locked";
  document.body.classList.toggle("away", link !== "open");
  if (link === "opening") return say("none", "OPENING", "asking the server");
  if (link === "locked") return say("none", "TOKEN NEEDED", "nothing is shown without it");
  if (link === "lost") {
    const since = Math.round((performance.now() - lostAt) / 1000), rest = "trying again; what stands here stays: is `wheelsoil view` still running?";
    return say("none", "NO CONNECTION", `the server has not answered for ${since} s, ${rest}`, `the server does not answer, ${rest}`); // a clock is not read out
  }
  const runs = state.campaigns.flatMap((campaign) => campaign.runs);
  const unread = runs.filter((run) => run.state === "waiting" || run.state === "processing").length;
  const busy = [...tasks].map((task) => task.words);
  if (unread) busy.push(`reading runs, ${runs.length - unread} of ${runs.length} done`);
  busy.push(...state.campaigns.filter((each) => each.diagnosis.state === "running").map((each) => `diagnosing ${each.name}`));
  if (busy.length) return say("busy", "WORKING", busy.join("; "));
  if (faults.length) return say("red", "NOT DONE", faults[0].what);
  return say("calm", "READY", runs.length ? "drag in a plot to select, double-click for all; ? lists the keys" : "there are no runs");
}

/** Say something that has been done, for some seconds. */
let fading;
export function note(words) {
  write(get("measure"), words);
  clearTimeout(fading);
  fading = setTimeout(() => { if (get("measure").textContent === words) write(get("measure"), ""); }, 5000);
}

function showFaults() {
  const make = () => {
    const item = part("li"), close = part("button", "icon close", "✕");
    close.type = "button";
    close.setAttribute("aria-label", "Close");
    item.append(part("strong"), part("dl"), close);
    return item;
  };
  list(get("faults"), faults, make, (item, fault) => {
    const [what, rows, close] = item.children;
    write(what, fault.what);
    const said = [["where", fault.where], ["found", fault.found], ["expected", fault.expected], ["do", fault.next_step]].filter(([, words]) => words);
    const row = () => {
      const box = part("div");
      box.append(part("dt"), part("dd"));
      return box;
    };
    list(rows, said, row, (box, [name, words]) => {
      write(box.children[0], name);
      write(box.children[1], words);
    });
    close.onclick = () => {
      faults = faults.filter((each) => each !== fault);
      show();
    };
  });
}

setInterval(() => link === "lost" && show(), 1000);
