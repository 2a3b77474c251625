// Campaigns and runs with their grade, what is usable, direction and verdict; which run is looked at, and with what it is compared.

import { capital } from "./channels.js";
import { change } from "./choice.js";
import { get, list, part, spaced, write } from "./dom.js";
import { chosenRun, entryOf, isUsed, load, samplesOf } from "./samples.js";
import { select } from "./selection.js";
import { current, on, runOf, state, tell } from "./store.js";

const GRADES = { good: ["green", "✓ good"], fair: ["amber", "▲ fair"], poor: ["red", "✕ poor"] };
const DIRECTIONS = { out: "→ out", back: "← back" };
const VERDICTS = { named: "cause named", one_of: "one of several causes", unexplained: "unexplained", nothing_detectable: "nothing detectable" };

function pick(place) {
  if (state.b && state.b.campaign === place.campaign && state.b.run === place.run) state.b = null;
  state.a = place;
  state.selection = null;
  tell("picked");
}

/** Look at the first run that can be looked at, and at another one when that is gone. */
function pickFirst() {
  if (runOf(state.a)) return;
  const all = state.campaigns.flatMap((campaign) => campaign.runs.map((run) => ({ campaign: campaign.key, run: run.key, state: run.state })));
  const first = all.find((each) => each.state === "ready") ?? all[0];
  if (first) pick({ campaign: first.campaign, run: first.run });
}

export const verdictOf = ({ state: now, verdict, sentence, why }) =>
  ({ none: "", running: "being diagnosed", failed: `not diagnosed: ${why}`, done: sentence || VERDICTS[verdict] })[now] ?? "";

function makeCampaign() {
  const box = part("section", "campaign");
  box.append(part("h2"), part("p", "about"), part("p", "said"), part("ol", "runs"));
  return box;
}

function showCampaign(box, campaign) {
  const [name, about, said, runs] = box.children;
  write(name, campaign.name);
  write(about, [campaign.terrain, campaign.vehicle, campaign.wheel && `wheel ${campaign.wheel.radius_m} m × ${campaign.wheel.width_m} m`].filter(Boolean).join(" · "));
  write(said, campaign.diagnosis.state === "done" ? VERDICTS[campaign.diagnosis.verdict] : verdictOf(campaign.diagnosis));
  said.title = campaign.diagnosis.sentence ?? "";
  said.hidden = campaign.diagnosis.state === "none";
  list(runs, campaign.runs, makeRun, (item, run) => showRun(item, campaign, run));
}

function makeRun() {
  const item = part("li"), use = part("input"), button = part("button", "run");
  use.type = "checkbox";
  button.type = "button";
  button.append(part("span", "name"), part("span", "tag"), part("span", "more"));
  item.append(use, button);
  return item;
}

function showRun(item, campaign, run) {
  const [use, button] = item.children, [name, tag, more] = button.children, used = isUsed(campaign.key, run);
  const ready = run.state === "ready", [level, word] = (ready && GRADES[run.grade]) || ["none", run.state];
  const mine = state.a?.campaign === campaign.key && state.a.run === run.key;
  use.checked = used;
  use.setAttribute("aria-label", `Use ${run.id}`);
  use.onchange = () => {
    const wanted = use.checked;
    change(campaign.key, (choice) => { entryOf(choice, run).use = wanted; });
  };
  button.setAttribute("aria-pressed", String(mine));
  button.classList.toggle("unused", !used);
  button.onclick = () => pick({ campaign: campaign.key, run: run.key });
  write(name, run.id);
  tag.dataset.level = level;
  write(tag, word);
  const share = run.usable_share === null || run.usable_share === undefined ? "" : `${Math.round(100 * run.usable_share)} % usable`;
  const facts = [share, DIRECTIONS[run.direction] ?? run.direction, run.rut_readings ? `${run.rut_readings} rut readings` : "", chosenRun(campaign.key, run)?.keep ? "cut by hand" : "", run.state === "failed" ? run.why : ""];
  write(more, facts.filter(Boolean).join(" · "));
}

function showCompare() {
  const menu = get("compare"), options = [["", "nothing"]];
  for (const campaign of state.campaigns) {
    if (campaign.key !== state.a?.campaign) options.push([JSON.stringify([campaign.key, null]), `${campaign.name}: all runs`]);
    for (const run of campaign.runs) {
      if (campaign.key === state.a?.campaign && run.key === state.a.run) continue;
      options.push([JSON.stringify([campaign.key, run.key]), `${campaign.name}: ${run.id}`]);
    }
  }
  list(menu, options, () => part("option"), (option, [value, words]) => {
    option.value = value;
    write(option, words);
  });
  const compared = state.b ? JSON.stringify([state.b.campaign, state.b.run]) : "";
  if (menu.value !== compared) menu.value = compared; // else an open menu would lose what the keys have reached
}

function showView() {
  const run = runOf(state.a), campaign = current();
  write(get("view-title"), run ? `${campaign.name}: ${run.id}${run.duration_s ? `, ${Math.round(run.duration_s)} s` : ""}` : "No run");
  document.title = run ? `${run.id} · ${campaign.name} · wheelsoil` : "wheelsoil view";
  const said = campaign ? verdictOf(campaign.diagnosis) : "";
  write(get("view-verdict"), said || "not diagnosed yet");
  list(get("notes"), run?.notes ?? [], () => part("li"), (item, words) => write(item, words));
  showReasons(state.a && samplesOf(state.a));
  const pending = run && run.state !== "ready" ? `${run.id}: ${run.state}${run.why ? `, ${run.why}` : ""}` : "reading";
  write(get("waiting"), run ? pending : "there is no run to show");
}

/** A button for each reason, with its share of all samples: it selects those that are excluded for it. */
function showReasons(data) {
  const rows = Object.entries(data?.shares ?? {}).sort((a, b) => b[1] - a[1]);
  const make = () => {
    const button = part("button", "chip");
    button.type = "button";
    return button;
  };
  list(get("reasons"), rows, make, (button, [code, share]) => {
    write(button, `${capital(spaced(code))} ${(100 * share).toFixed(1)} %`);
    const chosen = state.selection?.kind === "reason" && state.selection.code === code;
    button.setAttribute("aria-pressed", String(chosen));
    button.onclick = () => select(chosen ? null : { kind: "reason", code });
  });
}

function show() {
  pickFirst();
  list(get("campaigns"), state.campaigns, makeCampaign, showCampaign);
  list(get("remarks"), state.remarks, () => part("li"), (item, words) => write(item, words));
  showCompare();
  showView();
}

export function setUp() {
  get("compare").addEventListener("change", () => {
    const [campaign, run] = get("compare").value ? JSON.parse(get("compare").value) : [];
    state.b = campaign ? { campaign, run } : null;
    tell("picked");
  });
  get("part").addEventListener("change", () => { state.part = get("part").value; tell("shown"); });
  get("touch-selects").addEventListener("change", () => { state.touchSelects = get("touch-selects").checked; tell("shown"); });
  for (const [id, name] of [["show-left-out", "leftOut"], ["show-others", "others"]]) {
    get(id).addEventListener("change", () => { state[name] = get(id).checked; load(); tell("shown"); });
  }
  on("list", show);
  on("list", load);
  on("picked", show);
  on("picked", load);
  on("data", showView);
  on("selection", () => showReasons(state.a && samplesOf(state.a)));
}

