// The model by hand: the soil's sliders, those of each effect that is in it, the picker of effects, reading and load.

import { ask, query } from "./api.js";
import { sensible } from "./channels.js";
import { change } from "./choice.js";
import { bend } from "./curve.js";
import { get, part, place, spaced, write } from "./dom.js";
import { Picker } from "./picker.js";
import { Slider } from "./slider.js";
import { choiceOf, current, on, state, tell } from "./store.js";
import { during } from "./talk.js";

const known = new Map(); // campaign -> {soil, effects} of /api/parameters
const values = new Map(); // parameter -> value, of whatever effect
const bases = new Map(); // campaign -> what these were asked for
const boxes = new Map(); // effect that is on -> { box, sliders }
const sliders = new Map(); // parameter -> Slider
const soilSliders = new Map();
const chances = new Map(); // campaign -> { family: probability } of its diagnosis
let soil = {}; // what was moved by hand
let loadN = null;
let shownFor = null;
const judged = new Map(); // campaign -> { keys, values } of the model that its diagnosis recommends, if it recommends one
let picker;
let later = null; // values that came before the parameters were known

const SAME = 1e-6; // relative: the address keeps eight digits

/** An effect that is switched on begins where an estimate would, so that it is seen. */
const startOf = ({ start, value }) => start ?? value;
const about = () => known.get(state.a?.campaign);
const chosen = () => choiceOf(state.a?.campaign);
const effectsOn = () => chosen().effects ?? [];
export const sinkage = () => get("sinkage").querySelector("input:checked").value;

/** The effect of a name: its key, or the family's only form. */
export function effectOf(name, form = "") {
  const all = about()?.effects ?? [];
  return all.find((each) => each.key === name) ?? all.find((each) => each.family === name && (!form || each.form === form));
}

const inModel = () => (about()?.effects ?? []).filter((each) => effectsOn().includes(each.key)).flatMap((each) => each.parameters);

function body() {
  const held = Object.fromEntries(inModel().map((each) => [each.name, values.get(each.name) ?? startOf(each)]));
  return { sinkage: sinkage(), effects: effectsOn(), values: held, soil, load_n: loadN };
}

/** What undo, the address and a saved layout keep of the sliders. */
export const modelNow = () => ({ values: Object.fromEntries(inModel().filter(({ name }) => values.has(name)).map(({ name }) => [name, values.get(name)])), soil: { ...soil }, load: loadN });

/** What the sliders' model is called: "recommended" while it is the one that the diagnosis of this campaign recommends. */
function label() {
  const found = judged.get(state.a?.campaign), same = (p, q) => Math.abs(p - q) <= SAME * Math.max(Math.abs(p), Math.abs(q));
  if (!found || [...found.keys].sort().join() !== [...effectsOn()].sort().join()) return "model";
  const now = (name) => values.get(name) ?? soil[name] ?? about().soil.find((each) => each.name === name)?.value ?? NaN;
  return Object.entries(found.values).every(([name, value]) => same(now(name), value)) ? "recommended" : "model";
}

/** The model that a campaign's diagnosis recommends; null where it recommends none. */
export function setJudged(campaign, found) {
  const before = judged.get(campaign);
  if (JSON.stringify(before ?? null) === JSON.stringify(found)) return;
  if (found) judged.set(campaign, found);
  else judged.delete(campaign);
  if (shownFor === state.a?.campaign) redraw();
}

/** Put the sliders where they were; those that are not named go back. */
export function setModel({ values: given = {}, soil: moved = {}, load = null }) {
  if (!about()) {
    later = { values: given, soil: moved, load };
    return;
  }
  values.clear();
  soil = {};
  for (const each of about().soil) soilSliders.get(each.name)?.put(each.value);
  for (const each of inModel()) sliders.get(each.name)?.put(given[each.name] ?? startOf(each));
  loadN = load;
  get("load").value = load ?? "";
  setValues({ ...given, ...moved });
}

/** Bend the curve to what the sliders say. */
function redraw(since) {
  if (state.a && about()) bend(body(), since, label());
}

/** Put an effect into the model or take it out; the choice remembers it. */
export function setEffect(key, use) {
  change(state.a.campaign, (choice) => {
    const rest = (choice.effects ?? []).filter((each) => each !== key);
    choice.effects = use ? [...rest, key] : rest;
  });
}

/** Put values where the sliders are, the soil's among its own. */
export function setValues(given) {
  for (const [key, value] of Object.entries(given)) {
    const ofSoil = about()?.soil.find((each) => each.name === key);
    (ofSoil ? soilSliders : sliders).get(key)?.put(value);
    if (ofSoil) moveSoil(ofSoil, value);
    else values.set(key, value);
  }
  redraw();
  tell("model");
}

function moveSoil({ name, value: laboratory }, value) {
  if (value === laboratory) delete soil[name];
  else soil[name] = value;
  const fits = chosen().soil_prior ? "a fit estimates its own" : "a fit uses the laboratory's";
  write(get("soil-hint"), Object.keys(soil).length ? `moved; ${fits}` : "laboratory");
}

function moved(since) {
  redraw(since);
  tell("model");
}

function showSinkage() {
  get("sinkage").querySelector(`[value=${chosen().sinkage ?? "balanced"}]`).checked = true;
}

/** Say beside each slider what a fit found: estimates and held values by the parameter's name. */
export function tellFit(estimates, held) {
  for (const [name, slider] of [...sliders, ...soilSliders]) slider.tell(estimates[name], held[name]);
}

/** What a diagnosis says of the families, for the order of the picker. */
export function setChances(campaign, found) {
  chances.set(campaign, found);
  picker.show();
}

/** Which effects are identifiable depends on the runs and on the reading. */
const basis = ({ runs, choice }) => JSON.stringify([runs.map((run) => run.state), choice.sinkage, choice.run]);

async function showModel() {
  const campaign = state.a?.campaign;
  if (!current()?.runs.some((run) => run.state === "ready")) return;
  const now = basis(current());
  if (bases.get(campaign) !== now) {
    bases.set(campaign, now);
    const told = await during("asking for the model's parameters", ask(query("/api/parameters", { campaign })));
    if (!told) return bases.delete(campaign);
    known.set(campaign, told);
    tell("parameters");
  }
  if (state.a?.campaign !== campaign || !about()) return;
  if (shownFor !== campaign) {
    shownFor = campaign;
    soil = {};
    boxes.clear();
    showSoil();
    showSliders();
    if (later) setModel(later);
    later = null;
  }
  showSinkage();
  picker.show();
  redraw();
}

function showSoil() {
  soilSliders.clear();
  const rows = about().soil.map((each) => {
    const slider = new Slider(each, each.value, (value, since) => {
      moveSoil(each, value);
      moved(since);
    });
    soilSliders.set(each.name, slider);
    slider.backTo(each.value);
    return slider.row;
  });
  get("soil").replaceChildren(...rows);
  write(get("soil-hint"), "laboratory");
}

/** A slider for each parameter of the effects that are on. Those that stay on are left as they are, in the middle of a drag or a number. */
function showSliders() {
  const used = about().effects.filter((each) => effectsOn().includes(each.key));
  for (const key of boxes.keys()) if (!used.some((each) => each.key === key)) boxes.delete(key);
  for (const effect of used) if (!boxes.has(effect.key)) boxes.set(effect.key, slidersOf(effect));
  const shown = used.map(({ key }) => boxes.get(key));
  place(get("sliders"), shown.map(({ box }) => box));
  sliders.clear();
  for (const slider of shown.flatMap((each) => each.sliders)) sliders.set(slider.about.name, slider);
}

function slidersOf(effect) {
  const box = part("section", "effect-on"), head = part("h3", "", nameOf(effect)), away = part("button", "icon", "✕");
  const made = effect.parameters.map((parameter) => new Slider(parameter, values.get(parameter.name) ?? startOf(parameter), (value, since) => {
    values.set(parameter.name, value);
    moved(since);
  }));
  box.dataset.effect = effect.key;
  away.type = "button";
  away.setAttribute("aria-label", `Take ${nameOf(effect)} out`);
  away.addEventListener("click", () => setEffect(effect.key, false));
  head.title = effect.summary;
  head.append(part("small", "", effect.in_curve === false ? "seen in a fit only" : "in the model"), away);
  box.append(head, ...made.map((slider) => slider.row));
  return { box, sliders: made };
}

const capital = (words) => words[0].toUpperCase() + words.slice(1);
const nameOf = ({ family, form }) => capital(form ? `${spaced(family)} (${capital(spaced(form))})` : spaced(family));

/** The effects that are not in the model: the likeliest first, those that cannot be identified last. */
function options() {
  const found = chances.get(state.a?.campaign) ?? {}, chance = ({ family }) => found[family] ?? 0;
  return (about()?.effects ?? []).filter(({ key }) => !effectsOn().includes(key)).sort((p, q) => q.can - p.can || chance(q) - chance(p)).map((each) => ({
    key: each.key, name: nameOf(each), note: chance(each) >= 0.005 ? `${(100 * chance(each)).toFixed(1)} %` : "", off: !each.can,
    more: each.can ? `${each.summary}${each.in_curve === false ? " It does not show in this curve, only in a fit." : ""}` : `not identifiable here: ${each.why_not}`,
  }));
}

/** The server has taken (or refused) another choice: sliders follow it. */
function follow() {
  if (!about() || shownFor !== state.a?.campaign) return;
  const before = [...get("sliders").children].map(({ dataset }) => dataset.effect).sort().join(), now = [...effectsOn()].sort().join();
  write(get("effects-count"), `${about().effects.length - effectsOn().length} more`);
  const reading = sinkage();
  showSinkage();
  if (before === now && reading === sinkage()) return;
  showSliders();
  picker.show();
  redraw();
}

export function setUp() {
  picker = new Picker(get("effect-picker"), "Search effects", { options, take: ({ key }) => setEffect(key, true), most: 6 });
  get("sinkage").addEventListener("change", () => {
    const reading = sinkage();
    redraw();
    change(state.a.campaign, (choice) => { choice.sinkage = reading; });
  });
  get("load").addEventListener("change", (event) => {
    loadN = Number(get("load").value) > 0 ? Number(get("load").value) : null;
    moved(event.timeStamp);
  });
  on("load", (newtons) => {
    get("load").placeholder = newtons === null ? "" : String(Math.round(newtons));
    write(get("load-hint"), `${sensible(newtons, 3)} N, ${sinkage()}`);
  });
  on("picked", showModel);
  on("list", follow);
  on("list", () => {
    if (state.a && (shownFor !== state.a.campaign || bases.get(state.a.campaign) !== basis(current()))) showModel();
  });
}
