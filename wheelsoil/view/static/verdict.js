// Diagnose: the sentence, and the candidates; a click puts one into the model.

import { ask, query } from "./api.js";
import { confirmed, took } from "./choice.js";
import { get, list, part, spaced, write } from "./dom.js";
import { verdictOf } from "./list.js";
import { effectOf, setEffect, setValues } from "./model.js";
import { choiceOf, current, on } from "./store.js";
import { during, tellError } from "./talk.js";

const MOST = 8;
const LEAST = 0.01;
const kept = new Map(); // campaign -> { sentence, diagnosis }

async function diagnose() {
  const campaign = current();
  if (!(await confirmed())) return;
  kept.delete(campaign.key);
  const entry = await during(`asking for a diagnosis of ${campaign.name}`, ask("/api/diagnose", { campaign: campaign.key }));
  if (entry) took(entry);
}

async function show() {
  const campaign = current(), told = campaign?.diagnosis;
  const ready = campaign?.runs.some((run) => run.state === "ready");
  get("diagnose").disabled = !ready || told.state === "running";
  write(get("diagnose"), told?.state === "done" ? "Diagnose again" : "Diagnose");
  const words = told ? verdictOf(told) : "";
  write(get("verdict"), told?.state === "running" ? "diagnosis running: this takes a while; the page can be used in the meantime" : words || "not diagnosed yet");
  if (told?.state !== "done") return list(get("candidates"), [], makeRow, fillRow);
  await fetchOnce(campaign);
  if (current() === campaign || current()?.key === campaign.key) list(get("candidates"), rowsOf(kept.get(campaign.key)?.diagnosis), makeRow, fillRow);
}

async function fetchOnce({ key, diagnosis }) {
  if (kept.get(key)?.sentence === diagnosis.sentence) return;
  kept.set(key, { sentence: diagnosis.sentence });
  try {
    kept.set(key, { sentence: diagnosis.sentence, diagnosis: await ask(query("/api/diagnosis", { campaign: key })) });
  } catch (error) {
    kept.delete(key);
    tellError("the diagnosis", error);
  }
}

function rowsOf(diagnosis) {
  const causes = new Map((diagnosis?.causes ?? []).map((cause) => [cause.name, cause]));
  return (diagnosis?.candidates ?? []).filter(({ probability }) => probability >= LEAST).slice(0, MOST).map((each) => ({ ...each, cause: causes.get(each.name) }));
}

const percent = (share) => `${(100 * share).toFixed(share < 0.995 ? 1 : 0)} %`;

function makeRow() {
  const item = part("li"), button = part("button", "", "Put into the model");
  button.type = "button";
  item.append(part("span", "name"), part("meter"), part("span", "share"), part("span", "form"), button);
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
    const found = Object.fromEntries((cause?.parameters ?? []).map((each) => [each.name, each.value]));
    setValues(found);
  };
}

export function setUp() {
  get("diagnose").addEventListener("click", diagnose);
  for (const topic of ["list", "picked", "parameters"]) on(topic, show);
}
