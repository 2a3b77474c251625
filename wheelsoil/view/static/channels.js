// What a run is made of, as the plots name it.

export const CHANNELS = [
  { key: "slip", name: "slip", title: "Slip ratio", unit: "", digits: 2 },
  { key: "rim_speed_mps", name: "rim speed", short: "rim", title: "Rim speed", unit: "m/s", digits: 2 },
  { key: "ground_speed_mps", name: "ground speed", short: "ground", title: "Ground speed", unit: "m/s", digits: 2 },
  { key: "vertical_load_n", name: "vertical load", title: "Vertical load", unit: "kN", factor: 1e-3, digits: 2 },
  { key: "drawbar_pull_n", name: "drawbar pull", title: "Drawbar pull", unit: "N", digits: 0 },
  { key: "driving_torque_nm", name: "driving torque", title: "Driving torque", unit: "N m", digits: 0 },
  { key: "sinkage_m", name: "sinkage", title: "Sinkage", unit: "mm", factor: 1e3, digits: 1 },
  { key: "distance_m", name: "distance", title: "Distance", unit: "m", digits: 1 },
  { key: "time_s", name: "time", title: "Time", unit: "s", digits: 1 },
];

export const ROWS = [
  { key: "slip", title: "Slip ratio", channels: ["slip"], usual: true },
  { key: "speed", title: "Speed", channels: ["rim_speed_mps", "ground_speed_mps"], usual: true },
  { key: "load", title: "Vertical load", channels: ["vertical_load_n"], usual: true },
  { key: "pull", title: "Drawbar pull", channels: ["drawbar_pull_n"], modelled: true, usual: true },
  { key: "torque", title: "Driving torque", channels: ["driving_torque_nm"], modelled: true, usual: true },
  { key: "sinkage", title: "Sinkage", channels: ["sinkage_m"], modelled: true, usual: true },
  { key: "distance", title: "Distance", channels: ["distance_m"] },
];

export const channel = (key) => CHANNELS.find((each) => each.key === key);
export const capital = (text) => text[0].toUpperCase() + text.slice(1);
export const titleOf = ({ title, unit }) => (unit ? `${title} (${unit})` : title);

/** Whether a run has any number of a channel. */
export const has = (data, key) => Boolean(data?.[key]?.some((value) => value !== null));

/** Values in the unit that is shown. */
export const scaled = (values, { factor = 1 }) => (factor === 1 ? values : values?.map((value) => (value === null ? null : value * factor)));

/** Limits around the values, the outermost half percent left out, with a margin. */
export function limits(values, margin = 0.07) {
  const sorted = Float64Array.from(values.filter((value) => value !== null && value !== undefined)).sort();
  if (!sorted.length) return [0, 1];
  const at = (share) => sorted[Math.round(share * (sorted.length - 1))];
  const low = at(0.005), high = at(0.995), pad = margin * (high - low) || Math.abs(high) / 10 || 1;
  return [low - pad, high + pad];
}

const grouped = (digits) => digits.replace(/\B(?=(\d{3})+$)/g, "\u202f");

/** A number with few digits, as a person writes it. */
export function sensible(value, digits = 4) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size >= 1e9 || (size < 1e-4 && size > 0)) {
    const [mantissa, power] = value.toExponential(digits - 1).replace("e+", "e").split("e");
    return `${mantissa} × 10${power.replace(/[-\d]/g, (sign) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[sign] ?? "⁻")}`.replaceAll("-", "−");
  }
  return String(Number(value.toPrecision(digits))).replace(/\d+/, grouped).replaceAll("-", "−");
}

/** A number with so many decimals, as it stands in a column. */
export function fixed(value, digits) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const text = value.toFixed(digits);
  const [whole, rest] = (Number(text) === 0 ? text.replace("-", "") : text).replace("-", "−").split(".");
  return rest === undefined ? grouped(whole) : `${grouped(whole)}.${rest}`;
}
