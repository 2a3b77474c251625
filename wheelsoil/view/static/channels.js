// What a run is made of, as the plots name it.

export const CHANNELS = [
  { key: "drawbar_pull_n", name: "drawbar pull", unit: "N" },
  { key: "driving_torque_nm", name: "driving torque", short: "torque", unit: "N m" },
  { key: "sinkage_m", name: "sinkage", unit: "m" },
  { key: "vertical_load_n", name: "vertical load", short: "load", unit: "N" },
  { key: "slip", name: "slip", unit: "" },
  { key: "ground_speed_mps", name: "ground speed", short: "speed", unit: "m/s" },
  { key: "rim_speed_mps", name: "rim speed", unit: "m/s" },
];

export const channel = (key) => CHANNELS.find((each) => each.key === key);
export const capital = (text) => text[0].toUpperCase() + text.slice(1);
export const axisTitle = ({ name, unit }) => (unit ? `${name} (${unit})` : name);

/** Whether a run has any number of a channel. */
export const has = (data, key) => Boolean(data?.[key]?.some((value) => value !== null));

/** Limits around the values, the outermost half percent left out, with a margin. */
export function limits(values, margin = 0.07) {
  const sorted = values.filter((value) => value !== null && value !== undefined).sort((a, b) => a - b);
  if (!sorted.length) return [0, 1];
  const at = (share) => sorted[Math.round(share * (sorted.length - 1))];
  const low = at(0.005), high = at(0.995), pad = margin * (high - low) || Math.abs(high) / 10 || 1;
  return [low - pad, high + pad];
}

/** A number with few digits, as a person writes it. */
export function sensible(value, digits = 4) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  const shown = size >= 1e6 || (size < 1e-4 && size > 0) ? value.toExponential(digits - 1) : String(Number(value.toPrecision(digits)));
  const grouped = (digits) => (digits.length > 4 ? digits.replace(/\B(?=(\d{3})+$)/g, "\u202f") : digits);
  return shown.replace(/\d+/, grouped).replaceAll("-", "−");
}
