// Refit: the four models and the one of one's own, their values with intervals, their criteria.

import { ask } from "./api.js";
import { confirmed } from "./choice.js";
import { channel, sensible } from "./channels.js";
import { Job } from "./job.js";
import { setFitted } from "./curve.js";
import { get, part, write } from "./dom.js";
import { setValues, tellFit } from "./model.js";
import { campaignOf, current, on, state } from "./store.js";
import { during } from "./talk.js";

const OWN = "chosen";
const FITTED = { dp: channel("drawbar_pull_n"), t: channel("driving_torque_nm") };
const fits = new Map(); // campaign -> { fit, of: the choice it was made with }
const off = new Set(); // models whose curve is not drawn
const NAMES = { wong: "Wong", vasilev: "Vasil'ev", lyasko: "Lyasko", ding: "Ding" };
let inTables; // the fit that stands in the tables
let job;

async function refit() {
  const { key } = current();
  if (!(await confirmed())) return;
  const campaign = campaignOf(key), of = JSON.stringify(campaign.choice);
  const fit = await job.run(campaign.key, during(`fitting the models to ${campaign.name}`, ask("/api/fit", { campaign: campaign.key }).catch((error) => job.pardon(error))));
  if (!fit) return;
  get("fit-box").open = true;
  fits.set(campaign.key, { fit, of });
  show();
  const own = fit.models[OWN];
  if (own && state.a?.campaign === campaign.key) setValues(valuesOf(own)); // with the soil, where that was let move
}

const estimatesOf = (model) => Object.values(model?.estimates ?? {});
const valuesOf = (model) => ({ ...model.held, ...Object.fromEntries(estimatesOf(model).filter((each) => !each.derived).map((each) => [each.name, each.value])) });

function show() {
  const campaign = current(), found = fits.get(campaign?.key);
  get("refit").disabled = !campaign?.runs.some((run) => run.state === "ready");
  write(get("fit-hint"), found ? (found.of === JSON.stringify(campaign.choice) ? "as chosen" : "outdated") : "none yet");
  get("fit-tables").hidden = !found;
  tellFit({}, {});
  if (!found) {
    write(get("fit-says"), "fits Wong's model, Vasil'ev, Lyasko, Ding, and the effects that are on");
    setFitted([]);
    return;
  }
  const { fit, of } = found, outdated = of !== JSON.stringify(campaign.choice);
  write(get("fit-says"), outdated ? "The choice has changed since this fit: refit." : fit.notes.join("; "));
  get("fit-says").classList.toggle("outdated", outdated);
  get("fit-tables").classList.toggle("old", outdated);
  if (inTables !== fit) get("fit-tables").replaceChildren(criteria(fit), values(fit));
  inTables = fit;
  const estimates = Object.assign({}, ...Object.values(fit.models).map((model) => model.estimates), fit.models[OWN]?.estimates);
  tellFit(estimates, fit.models[OWN]?.held ?? {});
  drawCurves(fit);
}

function drawCurves(fit) {
  const shown = Object.entries(fit.curves).filter(([name]) => !off.has(name));
  setFitted(shown.map(([name, model]) => ({ model, name, label: `${labelOf(name)}, fitted` })));
}

const labelOf = (name) => NAMES[name] ?? name;

function table(caption, head, rows) {
  const box = part("div", "scroll"), made = part("table"), top = part("tr");
  made.append(part("caption", "", caption));
  for (const words of head) top.append(part("th", "", words));
  const body = part("tbody");
  for (const cells of rows) {
    const row = part("tr");
    for (const cell of cells) {
      const td = part("td");
      td.append(cell);
      row.append(td);
    }
    body.append(row);
  }
  const thead = part("thead");
  thead.append(top);
  made.append(thead, body);
  box.append(made);
  return box;
}

function switchOf(name, fit) {
  const label = part("label", "check"), input = part("input");
  input.type = "checkbox";
  input.checked = !off.has(name);
  input.addEventListener("change", () => {
    if (input.checked) off.delete(name);
    else off.add(name);
    drawCurves(fit);
  });
  label.append(input, ` ${labelOf(name)}`);
  return label;
}

function criteria(fit) {
  const box = part("div");
  for (const [key, { name, unit }] of Object.entries(FITTED)) {
    const rows = Object.entries(fit.models).filter(([, model]) => model.criteria[key]).map(([one, model]) => {
      const { M0_percent: m0, R0_N: r0, R2: r2 } = model.criteria[key];
      return [key === "dp" ? switchOf(one, fit) : labelOf(one), sensible(m0), sensible(r0), sensible(r2)];
    });
    if (rows.length) box.append(table(`Criteria, ${name}, slips from ${fit.slip_threshold} on`, ["model", "M₀ %", `R₀ ${unit}`, "R²"], rows));
  }
  return box;
}

function values(fit) {
  const rows = Object.entries(fit.models).flatMap(([name, model]) => estimatesOf(model).map((each) => {
    const value = part("span", "", sensible(each.value) + (each.unit === "1" ? "" : ` ${each.unit}`));
    const interval = each.interval.every((end) => end !== null) ? `${sensible(each.interval[0])} to ${sensible(each.interval[1])}` : "–";
    value.append(part("small", "", each.at_bound ? "at its bound" : interval));
    return [labelOf(name), each.name, value];
  }));
  return table(`Coefficients, with ${Math.round(100 * fit.confidence)} % intervals`, ["model", "name", "value"], rows);
}

export function setUp() {
  job = new Job(get("refit"), refit);
  on("list picked", showOnce);
}

/** Show again only where it is another campaign, choice or fit; the poll comes each second. */
let seen = "";
function showOnce() {
  const campaign = current(), now = JSON.stringify([campaign?.key, campaign?.choice, campaign?.runs.map((run) => run.state)]);
  if (now === seen) return;
  seen = now;
  show();
}
