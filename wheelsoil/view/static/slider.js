// A parameter: slider, box for its value, unit, bounds, reset; beside them what the fit says.

import { sensible } from "./channels.js";
import { part, write } from "./dom.js";

const SUFFIXES = { "m/s": "mps", "N m": "nm", N: "n" };

/** "height m" in m is a height. */
const plain = (label, unit) => (label.endsWith(` ${SUFFIXES[unit] ?? unit}`) ? label.slice(0, label.lastIndexOf(" ")) : label);

/** Make the row of a parameter P = {name, label, unit, value, neutral, low, high, step, source}; on(value) is called at each change. */
export class Slider {
  constructor(about, start, on) {
    this.about = about;
    this.on = on;
    this.row = part("div", "slider");
    const { name, label = name, unit, low, high, step } = about, title = part("span", "label", plain(label, unit));
    title.title = about.source || "";
    this.range = this.input("range", `${label}, slider`, low, high, step || (high - low) / 1000 || "any");
    this.box = this.input("number", `${label}, value`, "", "", "any");
    this.reset = part("button", "reset", "↺");
    this.reset.type = "button";
    this.reset.setAttribute("aria-label", `Reset ${label}`);
    this.reset.title = `back to ${sensible(this.about.neutral)}`;
    this.fit = part("p", "fitted");
    const boxed = part("span", "boxed");
    boxed.append(this.box, ` ${unit === "1" ? "" : unit}`);
    this.row.append(title, boxed, this.reset, part("span", "bound", sensible(low, 3)), this.range, part("span", "bound high", sensible(high, 3)), this.fit);
    this.row.dataset.parameter = name;
    this.range.addEventListener("input", (event) => this.take(Number(this.range.value), event.timeStamp));
    this.box.addEventListener("change", (event) => this.box.value !== "" && this.take(Number(this.box.value), event.timeStamp));
    this.reset.addEventListener("click", (event) => this.take(about.neutral, event.timeStamp));
    this.box.addEventListener("blur", () => this.write()); // what was typed by halves, or fitted meanwhile
    this.put(start);
  }

  input(type, label, min, max, step) {
    const made = part("input");
    Object.assign(made, { type, min: String(min), max: String(max), step: String(step) });
    made.setAttribute("aria-label", label);
    return made;
  }

  take(value, since) {
    this.put(value);
    this.write();
    this.on(this.value, since);
  }

  put(value) {
    const { low, high, lowest = low, highest = high } = this.about; // the box takes what the model does, the slider what is plausible
    this.value = Math.min(highest, Math.max(lowest, value));
    this.range.value = String(this.value);
    if (document.activeElement !== this.box) this.write(); // somebody types in it
  }

  write() {
    this.box.value = String(Number(this.value.toPrecision(6)));
  }

  /** Say what the fit found: an estimate {value, interval, at_bound}, what it held, or nothing. */
  tell(estimate, held) {
    const interval = estimate?.interval?.every((end) => end !== null) ? ` (95 %: ${sensible(estimate.interval[0])} to ${sensible(estimate.interval[1])})` : "";
    const bound = estimate?.at_bound ? ", at its bound" : "";
    write(this.fit, estimate ? `fit: ${sensible(estimate.value)}${interval}${bound}` : held === undefined ? "" : `held at ${sensible(held)} in the fit`);
  }
}
