// The model by hand: reading of the sinkage, effects, and a slider for each of their parameters and of the soil's.

import { ask, query } from "./api.js";
import { sensible } from "./channels.js";
import { change } from "./choice.js";
import { bend } from "./curve.js";
import { get, list, part, place, spaced, write } from "./dom.js";
import { Slider } from "./slider.js";
import { choiceOf, current, on, state, tell } from "./store.js";
import { during } from "./talk.js";

const KINDS = { physical: "Soil and wheel", measurement: "Measurement" };
const known = new Map(); // campaign -> {soil, effects} of /api/parameters
const values = new Map(); // parameter -> value, of whatever effect
const bases = new Map(); // campaign -> what these were asked for
const boxes = new Map(); // effect that is on -> { box, sliders }
const sliders = new Map(); // parameter -> Slider
const soilSliders = new Map();
let soil = {}; // what was moved by hand
let loadN = null;
let shownFor = null;

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

function body() {
  const parameters = (about()?.effects ?? []).filter((each) => effectsOn().includes(each.key)).flatMap((each) => each.parameters);
  const held = Object.fromEntries(parameters.map((each) => [each.name, values.get(each.name) ?? startOf(each)]));
  return { sinkage: sinkage(), effects: effectsOn(), values: held, soil, load_n: loadN };
}

/** Bend the curve to what the sliders say. */
function redraw(since) {
  if (state.a && about()) bend(body(), since);
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
  for (const [name, value] of Object.entries(given)) {
    const ofSoil = about()?.soil.find((each) => each.name === name);
    (ofSoil ? soilSliders : sliders).get(name)?.put(value);
    if (ofSoil) moveSoil(ofSoil, value);
    else values.set(name, value);
  }
  redraw();
}

function moveSoil({ name, value: laboratory }, value) {
  if (value === laboratory) delete soil[name];
  else soil[name] = value;
  const fits = chosen().soil_prior ? "a fit estimates its own" : "a fit uses the laboratory's";
  write(get("soil-hint"), Object.keys(soil).length ? `moved; ${fits}` : "laboratory values");
}

function showSinkage() {
  get("sinkage").querySelector(`[value=${chosen().sinkage ?? "balanced"}]`).checked = true;
}

/** Say beside each slider what a fit found: estimates and held values by the parameter's name. */
export function tellFit(estimates, held) {
  for (const [name, slider] of sliders) slider.tell(estimates[name], held[name]);
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
    if (state.a?.campaign === campaign && shownFor === campaign) showEffects();
  }
  if (state.a?.campaign !== campaign || !about()) return;
  if (shownFor !== campaign) {
    shownFor = campaign;
    soil = {};
    boxes.clear();
    showSoil();
    showEffects();
    showSliders();
  }
  showSinkage();
  redraw();
}

function showSoil() {
  const rows = about().soil.map((each) => {
    const slider = new Slider(each, each.value, (value, since) => {
      moveSoil(each, value);
      redraw(since);
    });
    soilSliders.set(each.name, slider);
    slider.reset.title = `back to ${sensible(each.value)}`;
    return slider.row;
  });
  get("soil").replaceChildren(...rows);
  write(get("soil-hint"), "laboratory values");
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
  get("no-effect").hidden = shown.length > 0;
}

function slidersOf(effect) {
  const box = part("div", "effect-on");
  const made = effect.parameters.map((parameter) => new Slider(parameter, values.get(parameter.name) ?? startOf(parameter), (value, since) => {
    values.set(parameter.name, value);
    redraw(since);
  }));
  box.append(part("h3", "", nameOf(effect)), ...made.map((slider) => slider.row));
  return { box, sliders: made };
}

const nameOf = ({ family, form }) => (form ? `${spaced(family)}: ${form}` : spaced(family));

function showEffects() {
  list(get("effects"), Object.entries(KINDS), makeGroup, (box, [kind, title]) => {
    const [legend, rows] = box.children;
    write(legend, title);
    list(rows, about().effects.filter((each) => each.kind === kind), makeEffect, showEffect);
  });
  search();
}

function makeGroup() {
  const box = part("fieldset", "effects");
  box.append(part("legend"), part("div"));
  return box;
}

function makeEffect() {
  const label = part("label", "effect"), input = part("input"), text = part("span");
  input.type = "checkbox";
  text.append(part("strong"), part("small"));
  label.append(input, text);
  return label;
}

function showEffect(label, effect) {
  const [input, text] = label.children, [name, small] = text.children;
  input.checked = effectsOn().includes(effect.key);
  input.disabled = !effect.can && !input.checked;
  input.onchange = () => setEffect(effect.key, input.checked);
  const unseen = effect.in_curve === false ? " It does not show in this curve, only in a fit." : "";
  write(name, nameOf(effect));
  write(small, effect.can ? effect.summary + unseen : `not identifiable here: ${effect.why_not}`);
  label.dataset.effect = effect.key;
  label.dataset.words = `${effect.key} ${nameOf(effect)} ${effect.summary}`.toLowerCase();
}

function search() {
  const wanted = get("effect-search").value.trim().toLowerCase().split(/\s+/);
  for (const box of get("effects").children) {
    const rows = [...box.querySelectorAll(".effect")];
    for (const row of rows) row.hidden = !wanted.every((word) => row.dataset.words.includes(word));
    box.hidden = rows.every((row) => row.hidden);
  }
}

/** The server has taken (or refused) another choice: switches and sliders follow it. */
function follow() {
  if (!about() || shownFor !== state.a?.campaign) return;
  const before = [...get("sliders").querySelectorAll("[data-parameter]")].map((row) => row.dataset.parameter).join();
  const now = about().effects.filter((each) => effectsOn().includes(each.key)).flatMap((each) => each.parameters.map(({ name }) => name)).join();
  for (const row of get("effects").querySelectorAll("[data-effect]")) row.querySelector("input").checked = effectsOn().includes(row.dataset.effect);
  write(get("effects-count"), effectsOn().length ? `${effectsOn().length} on` : "none on");
  const reading = sinkage();
  showSinkage();
  if (before === now && reading === sinkage()) return;
  showSliders();
  redraw();
}

export function setUp() {
  get("sinkage").addEventListener("change", () => {
    const reading = sinkage();
    redraw();
    change(state.a.campaign, (choice) => { choice.sinkage = reading; });
  });
  get("load").addEventListener("change", (event) => {
    loadN = Number(get("load").value) > 0 ? Number(get("load").value) : null;
    redraw(event.timeStamp);
  });
  get("effect-search").addEventListener("input", search);
  on("load", (newtons) => {
    get("load").placeholder = newtons === null ? "" : String(Math.round(newtons));
    write(get("load-hint"), loadN === null ? "empty: the run's median load" : "");
  });
  on("picked", showModel);
  on("list", follow);
  on("list", () => {
    if (state.a && (shownFor !== state.a.campaign || bases.get(state.a.campaign) !== basis(current()))) showModel();
  });
}
