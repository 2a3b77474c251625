// The plots: a pair for each channel, over time and over slip, linked by what is selected.

import { capital, CHANNELS, has } from "./channels.js";
import { CONFIG, plotly, SEGMENTS } from "./drawing.js";
import { get, list, part, place, write } from "./dom.js";
import { legendOf, overlayOf } from "./overlay.js";
import { samplesOf } from "./samples.js";
import { arrow, select } from "./selection.js";
import { on, runOf, state } from "./store.js";
import { contentOf } from "./traces.js";

const plots = new Map(); // "time drawbar_pull_n" -> { div, about, over }
const PAPER_WIDTH = 335;
const TOUCH = matchMedia("(pointer: coarse)");
let waiting = false;
let pressed = false; // a mouse button or finger is down in a plot: drawing anew would break the drag off
let late = false;
let drawing = 0; // how many draws are underway

function shownChannels() {
  const data = state.a && samplesOf(state.a), other = state.b && samplesOf(state.b);
  return CHANNELS.filter(({ key }) => state.shown.has(key) && (has(data, key) || has(other, key)));
}

/** What a channel is drawn over: slip only where it is known. */
function overs({ key }) {
  const slip = [state.a, state.b].some((place) => place && has(samplesOf(place), "slip"));
  return slip && key !== "slip" ? ["time", "slip"] : ["time"];
}

/** Make the pairs that are missing, drop those that are not wanted. */
function arrange(Plotly) {
  const wanted = shownChannels().flatMap((about) => overs(about).map((over) => ({ about, over, key: `${over} ${about.key}` })));
  for (const [key, { div }] of plots) {
    if (wanted.some((each) => each.key === key)) continue;
    Plotly.purge(div);
    plots.delete(key);
  }
  for (const { about, over, key } of wanted) if (!plots.has(key)) plots.set(key, made(about, over));
  place(get("plots"), wanted.map(({ key }) => plots.get(key).div.closest("figure")));
}

function made(about, over) {
  const figure = part("figure"), div = part("div", "plot");
  figure.append(part("figcaption", "", `${capital(about.name)} against ${over}`), div);
  div.id = `${over}-${about.key}`;
  div.tabIndex = 0;
  div.setAttribute("role", "group");
  div.addEventListener("pointerdown", () => { pressed = true; });
  if (over === "time") div.addEventListener("keydown", arrow);
  return { div, about, over };
}

function release() {
  pressed = false;
  if (late) draw();
  late = false;
}

/** Draw all again: other samples, other channels. */
export async function draw() {
  drawing += 1;
  get("plots").setAttribute("aria-busy", "true");
  try {
    await drawAll();
  } finally {
    drawing -= 1;
    get("plots").setAttribute("aria-busy", String(drawing > 0 || late));
  }
}

async function drawAll() {
  if (pressed) late = true;
  if (waiting || pressed) return;
  waiting = true;
  const Plotly = await plotly();
  await new Promise(requestAnimationFrame);
  waiting = false;
  if (pressed) late = true;
  if (pressed) return;
  const data = state.a && samplesOf(state.a);
  get("waiting").hidden = Boolean(data);
  for (const id of ["plots", "legend"]) get(id).hidden = !data; // what stands there is of another run
  if (!data) return;
  arrange(Plotly);
  showLegend();
  for (const plot of plots.values()) await drawOne(Plotly, plot);
}

/** On paper the plots are light, and two fit side by side on A4. */
function paper(print) {
  document.documentElement.toggleAttribute("data-paper", print);
  showLegend();
  for (const plot of plots.values()) drawOne(globalThis.Plotly, plot, print ? { width: PAPER_WIDTH } : {});
}

async function drawOne(Plotly, plot, size = {}) {
  const { div, about, over } = plot, { traces, layout } = contentOf(about, over);
  const more = { ...size, ...overlayOf(about, over), uirevision: JSON.stringify([state.a, state.b, state.part]), ...(over === "time" && { selectdirection: "h" }), ...(TOUCH.matches && !state.touchSelects && { dragmode: false }) };
  await Plotly.react(div, traces, { ...layout, ...more }, CONFIG);
  div.setAttribute("aria-label", `${capital(about.name)} against ${over} of ${runOf(state.a)?.id ?? ""}${over === "time" ? "; arrow keys move the selection, with Shift they stretch it" : ""}`);
  if (!plot.listens) listen(Plotly, plot);
}

function listen(Plotly, plot) {
  const { div, about, over } = plot;
  plot.listens = true;
  const taken = (event) => {
    if (!event?.range) return null;
    const [from, to] = [...event.range.x].sort((p, q) => p - q);
    if (over === "time") return { kind: "time", from, to };
    const [low, high] = [...event.range.y].sort((p, q) => p - q);
    return { kind: "slip", from, to, low, high, channel: about.key };
  };
  div.on("plotly_selecting", (event) => {
    const chosen = taken(event);
    if (!chosen) return;
    plot.dragged = true;
    select(chosen);
  });
  div.on("plotly_selected", (event) => {
    plot.dragged = false;
    const chosen = taken(event);
    if (chosen) select(chosen);
  });
  const showAll = () => { state.part = get("part").value = "all"; draw(); };
  if (over === "slip") for (const doubleClick of ["plotly_deselect", "plotly_doubleclick"]) div.on(doubleClick, showAll);
  div.on("plotly_relayout", (change) => follow(Plotly, plot, change));
}

/** Plots over the same axis show the same part of it. */
function follow(Plotly, from, change) {
  const [low, high] = change["xaxis.range"] ?? [change["xaxis.range[0]"], change["xaxis.range[1]"]];
  if (low === undefined) return;
  for (const plot of plots.values()) {
    const seen = plot.div.layout?.xaxis.range;
    if (plot !== from && plot.over === from.over && (seen?.[0] !== low || seen?.[1] !== high)) Plotly.relayout(plot.div, { "xaxis.range": [low, high] });
  }
}

/** Draw what lies over the samples again, at once; the plot that is being dragged in is left alone. */
export function drawOver(over) {
  const Plotly = globalThis.Plotly;
  if (!Plotly) return;
  const asked = [...plots.values()].filter((plot) => plot.listens && !plot.dragged && (!over || plot.over === over));
  for (const { div, about, over: axis } of asked) {
    if (div.layout.selections?.length) Plotly.relayout(div, { selections: [] });
    Plotly.relayout(div, { shapes: overlayOf(about, axis).shapes }); // alone, it is drawn in a millisecond or two
  }
}

function showLegend() {
  const make = () => {
    const item = part("li"), svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    svg.setAttribute("viewBox", "0 0 34 12");
    svg.append(document.createElementNS(svg.namespaceURI, "path"));
    item.append(svg, part("span"));
    return item;
  };
  const shapes = { line: "M1 6H33", circle: "M17 2a4 4 0 1 0 .01 0Z", small: "M17 4a2 2 0 1 0 .01 0Z", diamond: "M17 1L22 6L17 11L12 6Z", cross: "M13 2L21 10M21 2L13 10", patch: "M4 0H30V12H4Z" };
  const dashes = { solid: "", dash: "7 5", dot: "2 4", dashdot: "7 4 2 4", longdash: "10 4", longdashdot: "10 3 2 3" };
  const patches = Object.entries(SEGMENTS).map(([kind, { letter, fill }]) => [`${letter} ${kind}`, { kind: "patch", fill, stroke: "none" }]);
  list(get("legend"), [...legendOf(), ...patches], make, (item, [words, mark]) => {
    const shape = item.firstChild.firstChild, set = (name, value) => shape.setAttribute(name, value);
    set("d", shapes[mark.kind]);
    set("fill", mark.fill ?? "none");
    set("stroke", mark.stroke ?? "none");
    set("stroke-width", mark.width ?? 1.5);
    set("stroke-dasharray", dashes[mark.dash] ?? "");
    write(item.lastChild, words);
  });
}

/** Channels to choose from; one that was not measured says so. */
function showChannels() {
  const data = state.a && samplesOf(state.a), other = state.b && samplesOf(state.b);
  const make = () => {
    const label = part("label"), input = part("input");
    input.type = "checkbox";
    label.append(input, part("span"));
    return label;
  };
  const box = get("shown"), rest = box.querySelector(".checks-list") ?? box.appendChild(part("div", "checks-list"));
  list(rest, CHANNELS, make, (label, { key, name, short = name }) => {
    const there = !data || has(data, key) || has(other, key), [input, words] = label.children;
    input.checked = state.shown.has(key) && there;
    input.disabled = !there;
    write(words, there ? ` ${short}` : ` ${short}: not measured`);
    input.onchange = () => {
      if (input.checked) state.shown.add(key); else state.shown.delete(key);
      draw();
    };
  });
}

export function setUp() {
  on("picked", draw);
  on("shown", draw);
  on("data", () => { showChannels(); draw(); });
  on("selection", () => { showLegend(); drawOver(); });
  on("curves", () => { showLegend(); });
  for (const end of ["pointerup", "pointercancel"]) addEventListener(end, () => setTimeout(release));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  addEventListener("beforeprint", () => paper(true));
  addEventListener("afterprint", () => paper(false));
  showChannels();
}

