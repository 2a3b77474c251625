// Numbers as words.

import { known } from "./dom.js";

const LOSSES = {
  kernel: "lost in the kernel",
  queue: "dropped by the logger",
  counter: "lost by the rolling counter",
  missing: "missing from the usual rate",
};
const FLAGS = new Set(["ground_speed_valid", "transducer_status"]);
export const POSITION = new Set(["latitude", "longitude"]);

export const count = (n) => (known(n) ? Math.round(n).toLocaleString("en").replaceAll(",", "\u202f") : "not counted");
export const seconds = (s) => (s < 10 ? `${s.toFixed(1)} s` : s < 120 ? `${Math.round(s)} s` : `${Math.round(s / 60)} min`);
export const ago = (s) => (s < 0.5 ? "now" : `${seconds(s)} ago`);

/** "counter.can0.WFT_Forces" as words. */
export function lossName(name) {
  const [kind, ...where] = name.split(".");
  return LOSSES[kind] ? `${where.join(".")}: ${LOSSES[kind]}` : name;
}

export function duration(s) {
  const whole = Math.max(0, Math.floor(s)), two = (n) => String(n).padStart(2, "0");
  const minutes = `${two(Math.floor(whole / 60) % 60)}:${two(whole % 60)}`;
  return whole >= 3600 ? `${Math.floor(whole / 3600)}:${minutes}` : minutes;
}

export function figure(value, role) {
  if (!known(value)) return "–";
  const size = Math.abs(value);
  const places = POSITION.has(role) ? (size >= 1000 ? 3 : 5) : FLAGS.has(role) ? 0 : size >= 100 ? 0 : size >= 10 ? 1 : 2;
  const shown = value.toLocaleString("en", { minimumFractionDigits: places, maximumFractionDigits: places });
  return shown.replaceAll(",", "\u202f").replace("-", "−");
}
