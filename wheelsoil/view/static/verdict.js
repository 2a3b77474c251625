// Diagnose: the verdict in one line, the causes with their probabilities, and what an error becomes; one press takes the model.

import { ask, query } from "./api.js";
import { confirmed, took } from "./choice.js";
import { fixed } from "./channels.js";
import { get, list, part, spaced, write } from "./dom.js";
import { Job } from "./job.js";
import { verdictOf } from "./list.js";
import { effectOf, setChances, setEffect, setJudged, setValues } from "./model.js";
import { choiceOf, current, on } from "./store.js";
import { during, tellError } from "./talk.js";

const CHANNEL_NAMES = { dp: "pull", t: "torque", z: "sinkage" };
const MOST = 8;
const LEAST = 0.01;
const ERRORS = [["dp", "R0", "Pull (N)", 1], ["t", "R0", "Torque (N m)", 1], ["dp", "R2", "R², pull", 3]];
const kept = new Map(); // campaign -> { sentence, diagnosis }
let job;

async function diagnose() {
  const campaign = current();
  if (!(await confirmed())) return;
  kept.delete(campaign.key);
  const entry = await during(`asking for a diagnosis of ${campaign.name}`, ask("/api/diagnose", { campaign: campaign.key }));
  if (entry) took(entry);
}

async function show() {
  const campaign = current(), told = campaign?.diagnosis, ready = campaign?.runs.some((run) => run.state === "ready");
  if (told?.state === "running") job.begin(campaign.key);
  else if (job.campaign) job.end();
  get("diagnose").disabled = !ready;
  if (told?.state === "done") await fetchOnce(campaign);
  if (campaign && current()?.key !== campaign.key) return;
  const diagnosis = told?.state === "done" ? kept.get(campaign.key)?.diagnosis : undefined;
  showLine(told, diagnosis);
  showErrors(diagnosis);
  showCost(diagnosis);
  showSince(diagnosis?.since);
  const rows = rowsOf(diagnosis);
  write(get("causes-count"), diagnosis ? (diagnosis.refused ? "refused" : `${rows.length}`) : "not diagnosed");
  write(get("refused"), diagnosis?.refused ?? "");
  list(get("candidates"), rows, makeRow, fillRow);
}

async function fetchOnce({ key, diagnosis }) {
  if (kept.get(key)?.sentence === diagnosis.sentence) return;
  kept.set(key, { sentence: diagnosis.sentence });
  try {
    const found = await ask(query("/api/diagnosis", { campaign: key }));
    kept.set(key, { sentence: diagnosis.sentence, diagnosis: found });
    setChances(key, Object.fromEntries(found.candidates.map(({ name, probability }) => [name, probability])));
  } catch (error) {
    kept.delete(key);
    tellError("the diagnosis", error);
  }
}

/** The verdict's first sentence, its numbers, and what is next; the whole of it on a press. */
function showLine(told, diagnosis) {
  const line = get("verdict"), words = told ? verdictOf(told) : "";
  get("verdict-line").dataset.state = told?.state ?? "none";
  const model = recommendedOf(diagnosis);
  if (current()) setJudged(current().key, model);
  get("recommended").hidden = !model;
  if (!diagnosis) return write(line, told?.state === "running" ? `Diagnosis running, ${progressOf(told)}; the page can be used meanwhile.` : words || "Not diagnosed yet: Diagnose names what the simulation gets wrong.");
  const { gain, next } = diagnosis, best = diagnosis.causes[0];
  const parts = [part("b", "", diagnosis.finding)]; // a single size stands behind it by itself
  if (best?.parameters.length && diagnosis.sizes.length === 1) parts.push(keyed(part("span", "", diagnosis.sizes[0]), diagnosis, `cause.${best.name}.${best.parameters[0].name}`));
  const [was, now] = ["calibrated_soil", "with_causes"].map((which) => `error.${diagnosis.main_channel}.${which}`);
  if (gain?.held_out && diagnosis.figures[now]) {
    const better = part("span", "", `Held-out error, ${CHANNEL_NAMES[diagnosis.main_channel]} `), change = diagnosis.change_percent;
    better.append(figure(diagnosis, was), " → ", figure(diagnosis, now), ` ${diagnosis.figures[now].unit} `, part("strong", diagnosis.better ? "better" : "", `${fixed(-change, 0)} %`));
    parts.push(better);
  }
  parts.push(part("span", "rest", diagnosis.details));
  if (next) parts.push(part("span", "next", next));
  line.replaceChildren(...parts.flatMap((each) => [each, " "]));
  line.title = diagnosis.sentence;
}

const progressOf = ({ share, left_s: left }) => (share < 0.005 ? "just begun" : `${Math.round(100 * share)} % done${left === null ? "" : `, about ${left} s left`}`);

/** Mark what a part shows: the key of the quantity and its unrounded value. */
function keyed(made, { figures }, key) {
  if (figures[key]) Object.assign(made.dataset, { key, value: figures[key].value });
  return made;
}

/** A quantity as every other surface writes it. */
const figure = (diagnosis, key) => keyed(part("span", "", diagnosis.figures[key].text), diagnosis, key);

/** The model that the diagnosis recommends: all named causes with their values, and the soil that goes with them. */
function recommendedOf(diagnosis) {
  const causes = diagnosis?.verdict === "named" ? diagnosis.causes : [];
  const effects = causes.map((each) => effectOf(each.name, each.form));
  if (!effects.length || effects.some((each) => !each?.can)) return null;
  const soil = diagnosis.soils.find(({ campaign }) => campaign === current().name) ?? diagnosis.soils[0];
  return { keys: effects.map(({ key }) => key), values: { ...(soil?.values ?? {}), ...Object.fromEntries(causes.flatMap(({ parameters }) => parameters.map((each) => [each.name, each.value]))) } };
}

function take() {
  const found = recommendedOf(kept.get(current().key)?.diagnosis);
  if (!found) return;
  const on = choiceOf(current().key).effects ?? [];
  for (const key of on) if (!found.keys.includes(key)) setEffect(key, false);
  for (const key of found.keys) if (!on.includes(key)) setEffect(key, true);
  setValues(found.values);
}

function showErrors(diagnosis) {
  const { base, extended } = diagnosis?.gain?.held_out ?? {};
  get("error-box").hidden = !base;
  if (!base) return;
  const rows = ERRORS.filter(([channel]) => base.channels[channel] && extended.channels[channel]).map(([channel, key, words, digits]) => {
    const [before, after] = [base.channels[channel][key], extended.channels[channel][key]];
    const figures = ["calibrated_soil", "with_causes"].map((which) => `error.${channel}.${which}`);
    const cells = key === "R0" && diagnosis.figures[figures[1]] ? figures.map((each) => figure(diagnosis, each)) : [fixed(before, digits), fixed(after, digits)];
    return [words, ...cells, key === "R2" ? `${after < before ? "" : "+"}${fixed(after - before, digits)}` : `${after > before ? "+" : ""}${fixed((100 * (after - before)) / before, 0)} %`];
  });
  fillTable(get("error-table"), ["", "calibrated soil", diagnosis.model_title, "difference"], rows);
}

/** What the named causes cost, with and without them, in the words and numbers of the report. */
function showCost(diagnosis) {
  const told = diagnosis?.cost;
  get("cost-box").hidden = !told;
  if (!told) return;
  write(get("cost-note"), told.title);
  write(get("cost-says"), told.says);
  const rows = told.rows.map(([name, slip, without, withThem, key, interval, unit]) => {
    const change = part("span");
    change.append(figure(diagnosis, key), part("small", "", interval));
    return [`${name} (${unit})`, slip, without, withThem, change];
  });
  fillTable(get("cost-table"), ["", "slip", "without", "with", "difference, 95 %"], rows);
}

/** What has changed since the report or campaign that the page was started with, as the report says it. */
function showSince(told) {
  get("since-box").hidden = !told;
  if (!told) return;
  write(get("since-says"), told.says);
  fillTable(get("since-table"), told.rows.length ? ["", "last time", "now", "difference"] : [], told.rows.map(changeCells));
}

/** A row of changes: quantity, the other value, the own one, their difference and whether it is beyond the intervals. */
export function changeCells([name, other, own, difference, beyond, unit]) {
  const cell = part("span", "", difference);
  cell.append(part("small", "", { yes: "beyond", no: "within" }[beyond] ?? beyond));
  return [unit ? `${name} (${unit})` : name, ...[other, own].map((value) => value.replace("± ", "±\u00a0")), cell];
}

export function fillTable(table, head, rows) {
  const row = (cells, tag) => {
    const made = part("tr");
    made.append(...cells.map((cell, i) => {
      const box = part(i ? tag : cell === "" ? "td" : "th", "", typeof cell === "string" ? cell.replace("N m)", "N\u00a0m)") : "");
      if (typeof cell !== "string") box.append(cell);
      return box;
    }));
    return made;
  };
  table.replaceChildren(row(head, "th"), ...rows.map((cells) => row(cells, "td")));
}

function rowsOf(diagnosis) {
  const causes = new Map((diagnosis?.causes ?? []).map((cause) => [cause.name, cause]));
  return (diagnosis?.refused ? [] : diagnosis?.candidates ?? []).filter(({ probability }) => probability >= LEAST).slice(0, MOST).map((each) => ({ ...each, cause: causes.get(each.name) }));
}

const percent = (share) => (share > 0.999 ? "> 99.9 %" : `${(100 * share).toFixed(1)} %`);

function makeRow() {
  const item = part("li"), button = part("button", "", "Put into the model");
  button.type = "button";
  item.append(part("span", "name"), part("meter"), part("span", "share number"), part("span", "form"), button);
  return item;
}

function fillRow(item, { name, probability, cause }) {
  const [title, meter, share, form, button] = item.children, effect = effectOf(name, cause?.form);
  write(title, spaced(name));
  meter.value = probability;
  write(share, percent(probability));
  write(form, cause?.form ? `if so, ${spaced(cause.form)} with ${percent(cause.form_probability)}` : "");
  const inside = effect && choiceOf(current().key).effects?.includes(effect.key);
  button.disabled = !effect?.can || inside;
  write(button, inside ? "In the model" : "Put into the model");
  button.title = effect ? effect.summary : "";
  button.onclick = () => {
    setEffect(effect.key, true);
    setValues(Object.fromEntries((cause?.parameters ?? []).map((each) => [each.name, each.value])));
  };
}

export function setUp() {
  job = new Job(get("diagnose"), diagnose);
  get("recommended").addEventListener("click", take);
  get("verdict-line").addEventListener("click", (event) => { if (event.target !== get("recommended")) get("verdict-line").classList.toggle("open"); });
  on("list picked parameters", show);
}
