// What is compared: medians of both from all samples, the difference of the pull over slip, and of two campaigns causes and soils.

import { ask, query } from "./api.js";
import { fixed } from "./channels.js";
import { get, write } from "./dom.js";
import { line, scale, svg, text, ticks, tickText } from "./drawing.js";
import { campaignOf, choiceOf, on, runOf, state } from "./store.js";
import { during } from "./talk.js";
import { changeCells, fillTable } from "./verdict.js";

const ROWS = [
  ["Load (kN)", "load_n", 2, 1e-3], ["Ground speed (m/s)", "speed_mps", 2], ["Greatest slip", "greatest_slip", 2],
  ["Measured pull near slip 0.2 (N)", "pull_n", 0], ["Measured pull / load near slip 0.2", "pull_coefficient", 3], ["Greatest pull (N)", "greatest_pull_n", 0],
  ["Measured torque near slip 0.2 (N m)", "torque_nm", 0], ["Used (s)", "seconds", 0],
];
let asked = "";
let found = null; // { slip, groups }

const nameOf = (place) => (place.run ? `${runOf(place)?.id}` : campaignOf(place.campaign)?.name);
const sides = () => [state.b.run === null ? { campaign: state.a.campaign, run: null } : state.a, state.b]; // all runs beside all runs

async function show() {
  const ready = state.b && runOf(state.a)?.state === "ready" && (state.b.run === null || runOf(state.b)?.state === "ready");
  get("compare-box").hidden = !ready;
  if (!ready) {
    asked = "";
    return;
  }
  const [a, b] = sides(), now = JSON.stringify([a, b, choiceOf(a.campaign).run, choiceOf(b.campaign).run, campaignOf(b.campaign).runs.map((run) => run.state), [a, b].map(({ campaign }) => campaignOf(campaign).diagnosis.sentence)]);
  if (now === asked) return;
  asked = now;
  const told = await during("comparing", ask(query("/api/compare", { campaign: a.campaign, run: a.run ?? "", campaign_b: b.campaign, run_b: b.run ?? "" })));
  if (!told || asked !== now) return;
  found = told;
  const [one, other] = told.groups, names = a.campaign === b.campaign || a.run === null ? [a, b].map(nameOf) : [a, b].map((place) => `${campaignOf(place.campaign).name}, ${nameOf(place)}`);
  write(get("compare-note"), `${names[0]} − ${names[1]}, medians`);
  const minus = (p, q) => (p === null || q === null ? null : p - q);
  fillTable(get("compare-table"), ["", ...names, "difference"], ROWS.map(([words, key, digits, factor = 1]) => {
    const [p, q] = [one[key], other[key]].map((value) => (value === null ? null : value * factor)), difference = minus(p, q);
    return [words, fixed(p, digits), fixed(q, digits), `${difference > 0 ? "+" : ""}${fixed(difference, digits)}`];
  }));
  showChanges(told, names);
  draw();
}

/** Soil, causes and errors of two diagnosed campaigns, as the report compares itself with the last one. */
function showChanges({ changes, undiagnosed }, names) {
  get("changes-table").hidden = !changes;
  write(get("changes-says"), undiagnosed.length ? `Causes and soils are compared once ${undiagnosed.join(" and ")} ${undiagnosed.length > 1 ? "are" : "is"} diagnosed.` : changes ? "Beyond: by more than both 95 % intervals together." : "");
  if (!changes) return;
  fillTable(get("changes-table"), ["", ...names, "difference"], changes.map(changeCells).map(([name, other, own, difference]) => [name, own, other, difference]));
}

function draw() {
  const box = get("difference"), width = box.clientWidth, height = box.clientHeight;
  if (!found || !width || get("compare-box").hidden) return;
  const [p, q] = found.groups.map(({ curves }) => curves.drawbar_pull_n), seen = { all: () => true, driving: (slip) => slip > 0, braking: (slip) => slip < 0 }[state.part];
  const rows = found.slip.map((_, i) => i).filter((i) => p[i] !== null && q[i] !== null && seen(found.slip[i])), x = rows.map((i) => found.slip[i]), y = rows.map((i) => p[i] - q[i]);
  const figure = svg("svg", { class: "figure", width, height });
  if (!rows.length) figure.append(text("no slip in common", 54, 40, { class: "axis" }));
  else {
    const pad = 0.1 * (Math.max(0, ...y) - Math.min(0, ...y)) || 1, X = scale([Math.min(...x), Math.max(...x)], [54, width - 12]), Y = scale([Math.min(0, ...y) - pad, Math.max(0, ...y) + pad], [height - 26, 22]);
    const up = ticks(Y.limits, 3), across = ticks(X.limits, width / 70), path = svg("path", { class: "measured", d: line(x, y, X, Y) });
    path.points = { x, y };
    figure.append(svg("path", { class: "grid", d: up.map((value) => `M54 ${Y(value)}H${width - 12}`).join("") }), svg("path", { class: "zero", d: `M54 ${Y(0)}H${width - 12}` }), path, svg("path", { class: "samples own", d: x.map((value, i) => `M${X(value)} ${Y(y[i])}h0`).join("") }));
    figure.append(...up.map((value) => text(tickText(value, up[1] - up[0]), 48, Y(value) + 4, { class: "axis", "text-anchor": "end" })), ...across.map((value) => text(tickText(value, across[1] - across[0]), X(value), height - 10, { class: "axis", "text-anchor": "middle" })));
  }
  figure.append(text("Difference of pull (N)", 8, 13, { class: "title" }));
  box.replaceChildren(figure);
}

export function setUp() {
  new ResizeObserver(draw).observe(get("difference"));
  on("list picked data", show);
  on("shown", draw);
}
