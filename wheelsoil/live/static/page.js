// Shows the newest snapshot, and says so when it is none of now.

import { Commands } from "./commands.js";
import { Connection } from "./connection.js";
import { facts, get, known, list, part, spaced, write } from "./dom.js";
import { ago, count, duration, figure, lossName, seconds } from "./parts.js";
import { boundsOf, Plot } from "./plot.js";
import { takeToken, token } from "./token.js";

const STALE_MS = 2000;
const FRESH_S = 3;
const STATES = { recording: "RECORDING", between: "BETWEEN RUNS", stopping: "STOPPING" };
const LEVELS = { green: "✓ GREEN", amber: "▲ AMBER", red: "✕ RED" };
const MEANING = { green: "all is well", amber: "look at it soon", red: "data are lost or wrong now" };
const BUS_STATES = { up: "up", down: "DOWN", bus_off: "BUS-OFF" };
const BANDS = { green: "--band-go", amber: "--band-amber", red: "--band-stop", none: "--band-none" };
const GOAL = 0.5; // slip from which on a run is good
const ORDER = ["slip", "drawbar_pull", "vertical_load", "driving_torque", "wheel_speed", "ground_speed", "sinkage"];
const rank = ({ role }) => ORDER.indexOf(role);

const MPS = { "m/s": 1, "km/h": 1 / 3.6, kn: 1852 / 3600 };

const page = { vehicle: "", snapshot: null, newsAt: -Infinity, nowS: 0, pull: [], slip: [], spoken: "", highest: null, lost: 0 };
const commands = new Commands(leaving);
const slipPlot = new Plot(get("slip-plot"), "slip, %");
const pullPlot = new Plot(get("pull-plot"), "seconds before now");

function band(level, state, word, headline) {
  get("band").dataset.level = level;
  document.querySelector("meta[name=theme-color]").content = getComputedStyle(document.documentElement).getPropertyValue(BANDS[level]).trim();
  write(get("state"), state);
  write(get("level"), word);
  write(get("headline"), headline);
}

/** Spoken only when it changes, not four times a second. */
function speak(words) {
  if (words === page.spoken) return;
  page.spoken = words;
  write(get("spoken"), words);
}

function showBand() {
  const silentMs = performance.now() - page.newsAt, live = silentMs < STALE_MS;
  const lost = connection.state !== "open";
  document.title = `${live && page.snapshot ? LEVELS[page.snapshot.level] : "?"} ${page.snapshot?.vehicle ?? page.vehicle}`;
  get("main").classList.toggle("stale", !live);
  commands.take(page.snapshot, live && !lost);
  if (connection.state === "refused") {
    return token() ? stale("WRONG TOKEN", "the logger has another one") : stale("TOKEN NEEDED", "nothing is shown without it");
  }
  if (connection.state === "ended") return showEnded(page.snapshot);
  if (live) return showLive(page.snapshot);
  const since = page.snapshot ? `for ${seconds(silentMs / 1000)}` : "yet";
  if (lost) return stale("NO CONNECTION", `no connection to the logger ${since}, trying again`);
  return stale("NO NEWS", `no news from the logger ${since}`);
}

function stale(state, headline) {
  showReasons(page.snapshot?.reasons ?? []);
  get("do").hidden = true;
  band("none", state, "", headline);
  speak(state);
}

function showEnded(snapshot) {
  const failure = snapshot?.reasons.find(({ code }) => code === "disk_failed");
  if (!failure) return stale("LOGGER ENDED", "it was stopped and its file is closed");
  showReasons(snapshot.reasons.filter((each) => each !== failure));
  showStep(failure);
  band("red", "LOGGER ENDED", LEVELS.red, `${failure.where}: ${failure.what}`);
  speak(`LOGGER ENDED, red. ${failure.where}: ${failure.code}`);
}

function showLive(snapshot) {
  const { state, level, run } = snapshot;
  const [worst, ...others] = snapshot.reasons;
  showReasons(others); // the worst one stands in the band
  const meaning = worst ? `${worst.where}: ${worst.what}` : `${MEANING[level]}`;
  band(level, STATES[state] ?? state, LEVELS[level], state === "recording" ? `${duration(run.since_s)} · ${meaning}` : meaning);
  showStep(worst);
  const reasons = snapshot.reasons.map((each) => `${each.where}: ${each.code}`).join("; ");
  speak(`${STATES[state]}, ${level}. ${reasons}`);
}

function showStep(reason) {
  get("do").hidden = !reason?.next_step;
  write(get("do"), reason?.next_step ? `Do: ${reason.next_step}` : "");
}

function showReasons(reasons) {
  const make = () => {
    const item = document.createElement("li");
    item.append(part("span", "word"), " ", part("span", "where"), " ", part("span", "what"), part("span", "next"));
    return item;
  };
  list(get("reasons"), reasons, make, (item, reason) => {
    item.dataset.level = reason.level;
    const [word, where, what, next] = item.children;
    write(word, LEVELS[reason.level] ?? reason.level);
    write(where, reason.where);
    write(what, reason.what);
    write(next, `Do: ${reason.next_step}`);
    next.hidden = !reason.next_step;
  });
}

function showRun({ state, run, vehicle }) {
  write(get("run-title"), vehicle);
  write(get("run-id"), state === "between" ? "no run" : run.id);
  get("run-id").title = run.id ?? "";
  facts(get("run"), [
    [state === "between" ? "between runs for" : "duration", duration(run.since_s)],
    ["frames", count(run.frames)],
    ["file size", `${run.mb.toFixed(1)} MB`],
    ["part", String(run.part)],
    ["file", run.file, "", true],
  ]);
}

/** Whether a curve's last sample is of now. */
function isNow(rows) {
  return rows.length > 0 && page.nowS - rows.at(-1)[0] < FRESH_S;
}

function showValues(values) {
  const last = page.slip.at(-1);
  const slip = page.snapshot.setup.wheel_radius_m
    ? [{ role: "slip", value: isNow(page.slip) ? 100 * last[1] : null, unit: "%", age_s: last ? page.nowS - last[0] : null, level: "green" }]
    : [];
  const main = [...slip, ...values.filter((each) => rank(each) >= 0)].sort((a, b) => rank(a) - rank(b));
  const others = values.filter((each) => rank(each) < 0);
  get("others-box").hidden = !others.length;
  showTiles(get("values"), main.map(inUnit));
  showTiles(get("others"), others);
  showReach(last);
}

/** The ground speed in the unit that was chosen, whichever the DBC sends. */
export function inUnit(each) {
  if (!known(each.to_mps)) return each;
  return { ...each, value: known(each.value) ? (each.value * each.to_mps) / MPS[unit] : each.value, unit };
}

function showTiles(parent, values) {
  const make = () => {
    const item = document.createElement("li"), number = part("span", "number");
    number.append(part("span"), " ", part("small"));
    item.append(part("span", "name"), number, part("span", "age"));
    return item;
  };
  list(parent, values, make, (item, each) => {
    const [name, number] = item.children, age = item.lastElementChild, gone = !known(each.age_s) || each.age_s > 1.5;
    item.dataset.level = each.level;
    item.dataset.role = each.role;
    item.title = each.name ?? "";
    write(name, spaced(each.role) + (each.level in LEVELS && each.level !== "green" ? ` ${LEVELS[each.level]}` : ""));
    write(number.children[0], figure(gone && each.role !== "slip" ? null : each.value, each.role));
    write(number.children[1], each.unit);
    write(age, gone ? absence(each) : "");
    age.classList.toggle("old", gone && each.role !== "slip");
  });
}

function absence({ role, age_s }) {
  if (role === "slip") return known(age_s) ? `not known for ${seconds(age_s)}` : "not known yet";
  return known(age_s) ? `no frames for ${seconds(age_s)}` : "no frames yet";
}

/** A slip in whole percent that it has reached. */
const percent = (slip) => `${Math.floor(100 * slip + 1e-6)}\u00a0%`;

/** Whether the run is good to leave, and why: what it has reached, what is wrong, and what is to be looked at. */
function leaving() {
  const { highest, lost, snapshot } = page, ofLevel = (level) => snapshot.reasons.filter((each) => each.level === level);
  const reached = `slip has reached ${percent(highest)}`, [red, amber] = [ofLevel("red"), ofLevel("amber")];
  const short = noSlipEver(snapshot) ? "" : highest === null ? "the slip is not known" : highest < GOAL ? `${reached}, the goal is at least ${percent(GOAL)}` : "";
  const frames = lost ? [`${count(lost)} lost ${lost === 1 ? "frame" : "frames"}`] : [];
  const level = short || red.length ? "red" : amber.length || frames.length ? "amber" : "green";
  const full = (reasons) => reasons.map((each) => `${each.where}: ${each.what.replace(/\.$/, "")}`);
  const number = (reasons, word) => (reasons.length ? [`${reasons.length} ${word}`] : []);
  const say = (reds, ambers) => ({
    red: `Not good to leave yet: ${[...(short ? [short] : []), ...reds, ...frames].join("; ")}.`,
    amber: `Leave only after a look at: ${[...ambers, ...frames].join("; ")}.`,
    green: noSlipEver(snapshot) ? "Nothing is wrong; the slip is not known." : `Good to leave: ${reached}, and nothing is wrong.`,
  })[level];
  return { level, words: say(full(red), full(amber)), brief: say(number(red, "red"), number(amber, "amber")) };
}

/** The same below the values; a fault that stands in the band or in the list is not repeated. */
function showLeaving(snapshot) {
  get("leave").hidden = snapshot.state !== "recording" || noSlipEver(snapshot) !== "";
  const { level, brief } = leaving();
  get("leave").dataset.level = level === "green" ? "green" : "amber";
  write(get("leave"), `${level === "green" ? "✓" : "▲"} ${brief}`);
}

/** How far the slip went in this run, beside where it should go. */
function showReach(last) {
  const item = get("values").querySelector("[data-role=slip]");
  if (!item) return;
  if (!item.querySelector(".reach")) {
    const bar = part("span", "reach");
    bar.append(part("i"), part("u"), part("b"));
    item.insertBefore(bar, item.lastElementChild);
  }
  const [reached, , now] = item.querySelector(".reach").children, share = (s) => `${100 * Math.min(Math.max(s, 0), 1)}%`;
  reached.style.width = share(page.highest ?? 0);
  now.hidden = !isNow(page.slip);
  now.style.left = share(last?.[1] ?? 0);
  if (isNow(page.slip) && page.highest !== null) write(item.lastElementChild, `highest held ${percent(page.highest)} · goal at least ${percent(GOAL)}`);
}

function showBuses(buses) {
  const make = () => {
    const item = document.createElement("li"), head = part("div", "head");
    head.append(part("span"), part("span", "tag"));
    item.append(head, part("p", "detail"), part("dl", "facts"));
    return item;
  };
  list(get("buses"), buses, make, (item, bus) => {
    const [head, detail, numbers] = item.children;
    write(head.children[0], bus.name);
    write(head.children[1], `${BUS_STATES[bus.state] ?? bus.state} ${LEVELS[bus.level]}`);
    head.children[1].dataset.level = bus.level;
    write(detail, bus.detail ?? "");
    detail.hidden = !bus.detail;
    facts(numbers, [
      ["frames a second", known(bus.rate_hz) ? count(bus.rate_hz) : "not known yet"],
      ["bus load", known(bus.load_percent) ? `${bus.load_percent.toFixed(0)} %` : "bit rate not stated"],
      ["frames", count(bus.frames)],
      ["last frame", known(bus.age_s) ? ago(bus.age_s) : "none yet"],
      ["lost in the kernel", count(bus.kernel_drops), bus.kernel_drops ? "red" : ""],
      ["lost in the queue", count(bus.queue_drops), bus.queue_drops ? "red" : ""],
      ["error frames", count(bus.error_frames)],
      ["in no DBC", count(bus.unknown_frames)],
    ]);
  });
}

function showLogger({ disk, queue_percent, cpu_percent, rss_mb, clock, gnss }) {
  const gb = disk.free_mb >= 1000 ? `${(disk.free_mb / 1000).toFixed(1)} GB` : `${disk.free_mb.toFixed(0)} MB`;
  const left = known(disk.minutes) ? (disk.minutes >= 600 ? `${Math.round(disk.minutes / 60)} h` : `${Math.round(disk.minutes)} min`) : null;
  const items = [
    ["disk lasts", left ? `${left} (${gb})` : `${gb} free`, disk.level],
    ["queue", `${queue_percent.toFixed(0)} % full`, queue_percent > 50 ? "amber" : ""],
    ["CPU, of one core", known(cpu_percent) ? `${cpu_percent.toFixed(0)} %` : "not known yet"],
    ["memory", `${rss_mb.toFixed(0)} MB`],
    ["logger's clock", clock.steps ? `was set ${clock.steps} times` : "not set since start"],
  ];
  if (gnss) {
    const fix = gnss.fix === null ? "fix unknown" : gnss.fix ? "fix" : "NO FIX";
    items.push(["GNSS", fix + (known(gnss.age_s) ? `, ${ago(gnss.age_s)}` : ""), gnss.level]);
  }
  if (known(clock.offset_s)) {
    const drift = known(clock.drift_ppm) ? `, drift ${figure(clock.drift_ppm)} ppm` : "";
    const residual = known(clock.residual_s) ? `, ± ${(1000 * clock.residual_s).toFixed(2)} ms` : "";
    items.push(["GNSS time − logger's clock", `${figure(clock.offset_s)} s${drift}${residual}`, "", true]);
  }
  facts(get("logger"), items);
}

function showTexts({ losses, marks, remarks }) {
  const lost = Object.entries(losses).filter(([name, n]) => n && !name.startsWith("wrapped."));
  const least = (name) => (losses[name.replace(/^counter\./, "wrapped.")] && name.startsWith("counter.") ? "at least " : "");
  get("no-losses").hidden = lost.length > 0;
  facts(get("losses"), lost.map(([name, n]) => [lossName(name), least(name) + count(n), "", true]));
  get("no-marks").hidden = marks.length > 0;
  const make = () => {
    const item = document.createElement("li");
    item.append(part("time"), part("span"));
    return item;
  };
  list(get("marks"), [...marks].reverse(), make, (item, mark) => {
    write(item.children[0], new Date(1000 * mark.time_utc_s).toTimeString().slice(0, 8));
    write(item.children[1], mark.text || "(no note)");
  });
  get("remarks-box").hidden = !remarks.length;
  list(get("remarks"), remarks, () => part("li"), (item, words) => write(item, words));
}

const TURNING = "none shown live: the transducer's axes turn with the wheel";

/** Why the slip of this vehicle can never be shown, or "". */
function noSlipEver({ setup, values }) {
  if (setup.transducer_frame === "wheel") return TURNING;
  const roles = new Set(values.map((each) => each.role));
  const missing = ["drawbar_pull", "wheel_speed", "ground_speed"].filter((role) => !roles.has(role));
  if (missing.length) return `no slip: vehicle.toml names no ${missing.map(spaced).join(", no ")}`;
  if (!setup.wheel_radius_m) return "no slip: vehicle.toml has no [wheel] radius_m";
  return "";
}

function whyNoSlip(snapshot) {
  return noSlipEver(snapshot) || `no slip yet: needs both speeds, one of them above ${snapshot.setup.min_speed_mps ?? 0.5} m/s`;
}

function showPlots(snapshot, spanS) {
  const turning = snapshot.setup.transducer_frame === "wheel";
  if (turning) page.pull = page.slip = [];
  const kilo = Math.max(0, ...page.pull.map(([, n]) => Math.abs(n))) >= 2000, scale = kilo ? 1e-3 : 1;
  const yTitle = `drawbar pull, ${kilo ? "kN" : "N"}`, y = boundsOf(page.pull.map(([, n]) => scale * n), kilo ? 1 : 100);
  const pairs = page.slip.map(([, s, n]) => [100 * s, scale * n]);
  slipPlot.draw({ x: boundsOf(pairs.map(([s]) => s), 20, 6), y, yTitle, rows: pairs, joined: false, current: isNow(page.slip), empty: whyNoSlip(snapshot) });
  const rows = page.pull.map(([t, n]) => [t - page.nowS, scale * n]);
  const named = snapshot.values.some((each) => each.role === "drawbar_pull");
  const empty = turning ? TURNING : named ? `no drawbar pull in the last ${spanS} s` : "vehicle.toml names no drawbar pull";
  pullPlot.draw({ x: { low: -spanS, high: 0, step: spanS / 6 }, y, yTitle, rows, joined: true, current: isNow(page.pull), empty });
  const said = (row, unit) => (row ? `${figure(row[1])} ${kilo ? "kN" : "N"}${unit}` : "no data");
  get("slip-plot").setAttribute("aria-label", `Drawbar pull against slip, ${pairs.length} points, newest ${said(pairs.at(-1), pairs.length ? ` at ${figure(pairs.at(-1)[0])} % slip` : "")}`);
  get("pull-plot").setAttribute("aria-label", `Drawbar pull over the last ${spanS} s, newest ${said(rows.at(-1), "")}`);
}

function keep(kept, added, fresh, fromS) {
  return [...(fresh ? [] : kept), ...added].filter(([t]) => t > fromS);
}

const KEPT_UNIT = "wheelsoil.unit";
let unit = "m/s";
try {
  unit = MPS[localStorage.getItem(KEPT_UNIT)] ? localStorage.getItem(KEPT_UNIT) : unit;
} catch { /* a browser that keeps nothing */ }

function showUnit() {
  for (const button of get("units").children) button.setAttribute("aria-pressed", String(button.dataset.unit === unit));
  if (page.snapshot) showValues(page.snapshot.values);
}

get("units").addEventListener("click", ({ target }) => {
  unit = target.dataset.unit ?? unit;
  try {
    localStorage.setItem(KEPT_UNIT, unit);
  } catch { /* a browser that keeps nothing */ }
  showUnit();
});

const connection = new Connection({
  hello({ vehicle }) {
    page.vehicle = vehicle;
    get("ask-token").hidden = true;
    get("main").hidden = get("bar").hidden = false;
    if (!page.snapshot) write(get("run-title"), vehicle);
  },
  snapshot({ snapshot, age_s, curves, highest_slip, lost_frames }) {
    page.snapshot = snapshot;
    page.highest = highest_slip;
    page.lost = lost_frames;
    page.newsAt = performance.now() - 1000 * age_s;
    page.nowS = snapshot.session_s + age_s;
    page.pull = keep(page.pull, curves.pull, curves.fresh, page.nowS - curves.span_s);
    page.slip = keep(page.slip, curves.slip, curves.fresh, page.nowS - curves.span_s);
    showRun(snapshot);
    showValues(snapshot.values);
    showLeaving(snapshot);
    showBuses(snapshot.buses);
    showLogger(snapshot);
    showTexts(snapshot);
    showPlots(snapshot, curves.span_s);
    showBand();
  },
  refused() {
    get("ask-token").hidden = false;
    get("main").hidden = get("bar").hidden = true;
    showBand();
  },
});

get("ask-token").addEventListener("submit", (event) => {
  event.preventDefault();
  takeToken(get("token").value);
});
setInterval(showBand, 250);
showUnit();
