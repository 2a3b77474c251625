// The state in the page's address: run, comparison, zoom, parameters, rows. A reload and the back button keep it; the token stays behind the #.

import { CHANNELS } from "./channels.js";
import { setLayout } from "./layout.js";
import { modelNow, setModel } from "./model.js";
import { campaignOf, on, runOf, state, tell } from "./store.js";

const SETTLED_MS = 250;
let timer = 0, wanted = null, last = "";

const nameOf = ({ campaign, run }) => [campaignOf(campaign)?.name, ...(run === null ? [] : [runOf({ campaign, run })?.id])].join("/");

/** The run or campaign of a name; a campaign's name has no slash of its own on disk. */
function placeOf(name) {
  for (const { key, name: campaign, runs } of state.campaigns) {
    if (name === campaign) return { campaign: key, run: null };
    const run = name?.startsWith(`${campaign}/`) && runs.find(({ id }) => name === `${campaign}/${id}`);
    if (run) return { campaign: key, run: run.key };
  }
  return null;
}

const pairs = (values) => Object.entries(values).map(([name, value]) => `${name}:${Number(value.toPrecision(8))}`).join(",");
const unpaired = (words) => Object.fromEntries((words ?? "").split(",").filter(Boolean).map((each) => [each.slice(0, each.lastIndexOf(":")), Number(each.slice(each.lastIndexOf(":") + 1))]).filter(([name, value]) => name && Number.isFinite(value)));

function queryNow() {
  const { values, soil, load } = modelNow(), asked = new URLSearchParams();
  const put = (name, value) => { if (value) asked.set(name, value); };
  put("run", nameOf(state.a));
  put("with", state.b && nameOf(state.b));
  put("t", state.zoom?.map((at) => at.toFixed(2)).join("~"));
  put("slip", state.part === "driving" ? "" : state.part);
  put("rows", state.rows?.join("~"));
  put("cross", state.cross.x === "slip" && state.cross.y === "drawbar_pull_n" ? "" : `${state.cross.y}~${state.cross.x}`);
  put("others", state.colour === "density" ? "" : state.colour);
  put("p", pairs(values));
  put("soil", pairs(soil));
  put("load", load === null ? "" : String(load));
  return asked;
}

function write() {
  clearTimeout(timer);
  if (!state.a || !runOf(state.a) || wanted) return;
  const asked = queryNow(), view = JSON.stringify([asked.get("run"), asked.get("with")]), there = `${location.pathname}?${asked}${location.hash}`;
  if (there === location.pathname + location.search + location.hash) return;
  history[last && view !== last ? "pushState" : "replaceState"](null, "", there); // going back leads to the run before
  last = view;
}

function soon() {
  clearTimeout(timer);
  timer = setTimeout(write, SETTLED_MS);
}

/** Show what the address says, as far as it is there. */
function follow() {
  const asked = wanted ?? new URLSearchParams(location.search), a = placeOf(asked.get("run"));
  wanted = null;
  if (a?.run && (a.campaign !== state.a?.campaign || a.run !== state.a.run)) Object.assign(state, { a, selection: null, cursor: null, predictions: {} });
  const b = placeOf(asked.get("with")), zoom = (asked.get("t") ?? "").split("~").map(Number), cross = (asked.get("cross") ?? "drawbar_pull_n~slip").split("~");
  state.b = b;
  state.zoom = zoom.length === 2 && zoom[0] < zoom[1] ? zoom : null;
  if (state.a) tell("picked");
  setLayout({ rows: asked.get("rows")?.split("~"), cross: CHANNELS.some(({ key }) => key === cross[1]) ? { y: cross[0], x: cross[1] } : undefined, colour: asked.get("others") ?? "density", part: asked.get("slip") ?? "driving" });
  setModel({ values: unpaired(asked.get("p")), soil: unpaired(asked.get("soil")), load: Number(asked.get("load")) || null });
  last = JSON.stringify([asked.get("run"), asked.get("with")]);
}

/** Before the first list is shown: the run that the address names is the one that is looked at. */
export function arrive() {
  if (!wanted) return;
  const a = placeOf(wanted.get("run"));
  if (a?.run) state.a = a;
  follow();
}

export function setUp() {
  if (location.search) wanted = new URLSearchParams(location.search);
  addEventListener("popstate", follow);
  on("picked shown zoom model list", soon);
}
