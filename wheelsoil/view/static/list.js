// Campaigns and runs: which run is looked at, which are used, and with what it is compared.

import { capital, fixed } from "./channels.js";
import { change } from "./choice.js";
import { get, list, part, spaced, write } from "./dom.js";
import { chosenRun, entryOf, isUsed, load, samplesOf } from "./samples.js";
import { select } from "./selection.js";
import { current, on, runOf, state, tell } from "./store.js";

const GRADES = { good: "", fair: "▲ fair", poor: "✕ poor" };

/** Look at a run, from its beginning to its end. */
export function pick(place) {
  if (state.b && state.b.campaign === place.campaign && state.b.run === place.run) state.b = null;
  Object.assign(state, { a: place, selection: null, zoom: null, cursor: null, predictions: {} });
  tell("picked");
}

/** The next run or the one before, in the order of the list. */
export function pickNext(by) {
  const all = state.campaigns.flatMap(({ key, runs }) => runs.map((run) => ({ campaign: key, run: run.key })));
  const at = all.findIndex(({ campaign, run }) => campaign === state.a?.campaign && run === state.a.run), next = all[at + by];
  if (next) pick(next);
}

/** Compare with a place, or with nothing. */
export function compareWith(place) {
  state.b = place;
  tell("picked");
}

/** Look at the first run that can be looked at, and at another one when that is gone. */
function pickFirst() {
  if (runOf(state.a)) return;
  const all = state.campaigns.flatMap((campaign) => campaign.runs.map((run) => ({ campaign: campaign.key, run: run.key, state: run.state })));
  const first = all.find((each) => each.state === "ready") ?? all[0];
  if (first) pick({ campaign: first.campaign, run: first.run });
}

export const verdictOf = ({ state: now, sentence, why }) =>
  ({ none: why ? `Not diagnosed: ${why}. Diagnose starts it again.` : "", running: "being diagnosed", failed: `not diagnosed: ${why}`, done: sentence })[now] ?? "";

function makeCampaign() {
  const box = part("details", "campaign"), head = part("summary");
  head.append(part("b", "name"), part("span", "right"));
  box.append(head, part("p", "hint"), part("ol", "runs"));
  box.addEventListener("toggle", () => { box.dataset.turned = "yes"; });
  return box;
}

/** A campaign stands open where it is the one that is looked at, until somebody opens or closes it. */
function showCampaign(box, campaign) {
  const [head, about, runs] = box.children, [name, count] = head.children, mine = campaign.key === state.a?.campaign;
  if (box.dataset.campaign !== campaign.key || box.dataset.mine !== String(mine)) {
    if (mine || box.dataset.campaign !== campaign.key) box.open = mine;
    Object.assign(box.dataset, { campaign: campaign.key, mine });
  }
  const ready = campaign.runs.find(({ start_ns: start }) => start), day = ready ? new Date(ready.start_ns / 1e6).toLocaleDateString("en-GB", { day: "numeric", month: "short", year: "numeric", timeZone: "UTC" }) : "";
  write(name, campaign.name);
  write(count, campaign.runs.length > 9 || !box.open ? `${campaign.runs.length} runs` : day);
  write(about, [campaign.terrain !== campaign.name && campaign.terrain, campaign.vehicle, campaign.wheel && `wheel ${campaign.wheel.radius_m} × ${campaign.wheel.width_m} m`, campaign.diagnosis.state === "done" && `verdict: ${campaign.diagnosis.verdict}`].filter(Boolean).join(" · "));
  about.title = campaign.diagnosis.sentence ?? "";
  list(runs, campaign.runs, makeRun, (item, run) => showRun(item, campaign, run));
}

function makeRun() {
  const item = part("li"), use = part("input"), button = part("button", "run");
  use.type = "checkbox";
  button.type = "button";
  button.append(part("span", "name"), part("span", "number"), part("span", "more"), part("span", "tag"));
  item.append(use, button);
  return item;
}

function showRun(item, campaign, run) {
  const [use, button] = item.children, [name, load, more, tag] = button.children, used = isUsed(campaign.key, run);
  const ready = run.state === "ready", onRoad = !run.on_soil && !run.refused, mine = state.a?.campaign === campaign.key && state.a.run === run.key;
  use.checked = used && !run.refused;
  use.disabled = Boolean(run.refused);
  use.setAttribute("aria-label", `Use ${run.id}`);
  use.onchange = () => {
    const wanted = use.checked;
    change(campaign.key, (choice) => { entryOf(choice, run).use = wanted; });
  };
  item.classList.toggle("on", mine);
  button.setAttribute("aria-pressed", String(mine));
  button.classList.toggle("unused", !used || Boolean(run.refused));
  button.onclick = () => pick({ campaign: campaign.key, run: run.key });
  button.title = run.refused ?? (run.state === "failed" ? run.why : onRoad ? "No soil is fitted to it; how it coasts is data of a diagnosis" : ready ? `${run.grade}, ${Math.round(100 * (run.usable_share ?? 0))} % of the samples in motion usable` : run.state);
  write(name, run.id);
  write(load, ready && run.load_n !== null ? `${fixed(run.load_n / 1000, 1)} kN` : "");
  const facts = [onRoad && "on firm ground: a static test", run.direction, `pass ${run.pass_number}`, chosenRun(campaign.key, run)?.keep ? "cut" : "", run.rut_readings ? `${run.rut_readings} ruts` : ""];
  write(more, run.refused ?? (run.state === "failed" ? run.why : facts.filter(Boolean).join(", ")));
  write(tag, run.refused ? "✕ set aside" : ready && onRoad ? "" : ready ? GRADES[run.grade] || (run.greatest_slip === null ? "" : `slip ${fixed(run.greatest_slip, 2)}`) : run.state);
  tag.dataset.level = ready && !onRoad ? run.grade : run.state;
}

const placeOf = (value) => {
  const [campaign, run] = value ? JSON.parse(value) : [];
  return campaign ? { campaign, run } : null;
};

/** Fill a menu; groups are [label, [[place, words], ...]]. */
function fillMenu(menu, first, groups, place) {
  const words = JSON.stringify([first, groups]);
  if (menu.dataset.words !== words) {
    menu.dataset.words = words;
    const option = ([at, said]) => Object.assign(part("option", "", said), { value: at ? JSON.stringify(at) : "" });
    menu.replaceChildren(...first.map(option), ...groups.filter(([, items]) => items.length).map(([label, items]) => {
      const group = part("optgroup");
      group.label = label;
      group.append(...items.map(option));
      return group;
    }));
  }
  const value = place ? JSON.stringify([place.campaign, place.run]) : "";
  if (menu.value !== value) menu.value = value; // else an open menu would lose what the keys have reached
}

function showMenus() {
  const own = state.campaigns.map(({ key, name, runs }) => [name, runs.map((run) => [[key, run.key], `${name}: ${run.id}`])]);
  fillMenu(get("run-pick"), [], own, state.a);
  const others = state.campaigns.map(({ key, name, runs }) => [name, [...(key === state.a?.campaign ? [] : [[[key, null], `${name}: all runs`]]), ...runs.filter((run) => key !== state.a?.campaign || run.key !== state.a.run).map((run) => [[key, run.key], `${name}: ${run.id}`])]]);
  fillMenu(get("compare"), [["", "Compare: nothing"]], others, state.b);
}

function showView() {
  const run = runOf(state.a), campaign = current(), all = state.campaigns.flatMap(({ key, runs }) => runs.map((each) => isUsed(key, each) && !each.refused));
  write(get("used-count"), `${all.filter(Boolean).length} of ${all.length} used`);
  write(get("view-title"), run ? `${campaign.name}: ${run.id}` : "No run");
  document.title = run ? `${run.id} · ${campaign.name} · wheelsoil` : "wheelsoil view";
  write(get("samples-of"), run ? run.id : "the run");
  list(get("notes"), run?.notes ?? [], () => part("li"), (item, words) => write(item, words));
  showReasons(state.a && samplesOf(state.a));
  const pending = run && run.state !== "ready" ? `${run.id}: ${run.state}${run.why ? `, ${run.why}` : ""}` : "reading";
  write(get("waiting"), run ? pending : "there is no run to show");
  const began = run?.start_ns ? new Date(run.start_ns / 1e6).toISOString().slice(0, 16).replace("T", " ") : "";
  write(get("basis"), began ? `100 Hz · filtered at ${fixed(run.cutoff_hz, 1)} Hz · t = 0 at ${began} UTC` : "");
}

/** A button for each reason, with its share of all samples: it selects those that are excluded for it. */
function showReasons(data) {
  const rows = Object.entries(data?.shares ?? {}).sort((a, b) => b[1] - a[1]);
  const make = () => {
    const button = part("button", "reason");
    button.type = "button";
    button.append(part("span"), part("span", "number"));
    return button;
  };
  list(get("reasons"), rows, make, (button, [code, share]) => {
    write(button.firstChild, capital(spaced(code)));
    write(button.lastChild, `${(100 * share).toFixed(1)} %`);
    const chosen = state.selection?.kind === "reason" && state.selection.code === code;
    button.setAttribute("aria-pressed", String(chosen));
    button.onclick = () => select(chosen ? null : { kind: "reason", code });
  });
}

function show() {
  pickFirst();
  list(get("campaigns"), state.campaigns, makeCampaign, showCampaign);
  list(get("remarks"), state.remarks, () => part("li"), (item, words) => write(item, words));
  showMenus();
  showView();
}

function showPart() {
  get("part").querySelector(`[value=${state.part}]`).checked = true;
}

export function setUp() {
  get("run-pick").addEventListener("change", () => pick(placeOf(get("run-pick").value)));
  get("compare").addEventListener("change", () => compareWith(placeOf(get("compare").value)));
  get("part").addEventListener("change", (event) => {
    state.part = event.target.value;
    tell("shown");
  });
  get("show-left-out").addEventListener("change", () => {
    state.leftOut = get("show-left-out").checked;
    tell("shown");
  });
  on("list picked", show);
  on("list picked shown", load);
  on("shown", showPart);
  on("data", showView);
  on("selection", () => showReasons(state.a && samplesOf(state.a)));
}
