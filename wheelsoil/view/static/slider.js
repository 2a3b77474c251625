// A parameter in one row: letter, slider with the fit's interval and the laboratory's value, box, unit, reset.

import { sensible } from "./channels.js";
import { part, write } from "./dom.js";

const SHORT = 5;
const shownUnit = (words) => (words === "1" ? "" : words.replace("^(n+1)", "ⁿ⁺¹").replace("^(n+2)", "ⁿ⁺²"));

/** Make the row of a parameter P = {name, label, words, letter, unit, value, neutral, low, high, step, source}; on(value) is called at each change. */
export class Slider {
  constructor(about, start, on) {
    this.about = about;
    this.on = on;
    this.row = part("div", "slider");
    const { name, label = name, words = label, letter: shown = words, unit, low, high, step } = about, [letter, index] = shown.length <= 3 ? shown.split("_") : [shown];
    const title = part("span", "label", letter);
    if (index) title.append(part("sub", "", index));
    title.title = [words, about.source].filter(Boolean).join(": ");
    this.row.classList.toggle("long", shown.length > SHORT);
    this.range = this.input("range", `${label}, slider`, low, high, step || (high - low) / 1000 || "any");
    this.box = this.input("number", `${label}, value`, "", "", "any");
    this.reset = part("button", "icon reset", "↺");
    this.reset.type = "button";
    this.reset.setAttribute("aria-label", `Reset ${label}`);
    this.backTo(about.neutral);
    this.fit = part("p", "fitted");
    this.track = part("div", "track");
    this.interval = part("i", "interval");
    this.interval.hidden = true;
    const tick = part("i", "laboratory");
    tick.style.setProperty("left", this.share(about.neutral));
    this.track.append(this.interval, tick, this.range);
    this.row.append(title, this.track, this.box, this.unit(unit), this.reset, this.fit);
    this.row.dataset.parameter = name;
    this.range.addEventListener("input", (event) => this.take(Number(this.range.value), event.timeStamp));
    this.box.addEventListener("change", (event) => this.box.value !== "" && this.take(Number(this.box.value), event.timeStamp));
    this.reset.addEventListener("click", (event) => this.take(about.neutral, event.timeStamp));
    this.box.addEventListener("blur", () => this.write()); // what was typed by halves, or fitted meanwhile
    this.put(start);
  }

  /** Say what the reset goes back to. */
  backTo(value) {
    this.reset.title = `back to ${sensible(value)} ${shownUnit(this.about.unit)}`.trimEnd();
  }

  unit(words) {
    const made = part("span", "unit", shownUnit(words));
    made.title = words;
    return made;
  }

  input(type, label, min, max, step) {
    const made = part("input");
    Object.assign(made, { type, min: String(min), max: String(max), step: String(step) });
    made.setAttribute("aria-label", label);
    return made;
  }

  /** Where a value stands on the slider, whose knob is 12 px wide. */
  share(value) {
    const { low, high } = this.about, at = Math.min(1, Math.max(0, (value - low) / (high - low || 1)));
    return `calc(6px + ${at} * (100% - 12px))`;
  }

  take(value, since) {
    this.put(value);
    this.write();
    this.on(this.value, since);
  }

  put(value) {
    const { low, high, lowest = low, highest = high, neutral } = this.about; // the box takes what the model does, the slider what is plausible
    this.value = Math.min(highest, Math.max(lowest, value));
    this.range.value = String(this.value);
    this.row.classList.toggle("moved", this.value !== neutral);
    if (document.activeElement !== this.box) this.write(); // somebody types in it
  }

  write() {
    this.box.value = String(Number(this.value.toPrecision(6)));
  }

  /** Say what the fit found: an estimate {value, interval, at_bound}, what it held, or nothing. */
  tell(estimate, held) {
    const known = estimate?.interval?.every((end) => end !== null), [low, high] = known ? estimate.interval : [0, 0];
    const interval = known ? ` (95 %: ${sensible(low)} to ${sensible(high)})` : "", bound = estimate?.at_bound ? ", at its bound" : "";
    this.interval.hidden = !known;
    if (known) {
      this.interval.style.setProperty("left", this.share(low));
      this.interval.style.setProperty("right", `calc(100% - ${this.share(high).slice(5, -1)})`);
    }
    write(this.fit, estimate ? `fit: ${sensible(estimate.value)}${interval}${bound}` : held === undefined ? "" : `held at ${sensible(held)} in the fit`);
  }
}
