// Figures and samples as files, and the address of what is shown.

import { CHANNELS } from "./channels.js";
import { figureOfCross } from "./cross.js";
import { get } from "./dom.js";
import { standalone } from "./drawing.js";
import { figureOfRows } from "./rows.js";
import { samplesOf } from "./samples.js";
import { current, runOf, state } from "./store.js";
import { note } from "./talk.js";
import { figureOfTrack } from "./track.js";

const FIGURES = { rows: [figureOfRows, "time histories"], cross: [figureOfCross, "cross plot"], track: [figureOfTrack, "track"] };

/** The samples that are drawn, one a line; values that are missing are empty. */
export function csvOf(data) {
  const names = ["time_s", ...CHANNELS.map(({ key }) => key).filter((key) => key !== "time_s" && data[key]), ...["east_m", "north_m"].filter((key) => data[key])];
  const rows = data.time_s.map((_, i) => [...names.map((name) => data[name][i] ?? ""), data.used[i] ? 1 : 0, data.reason[i]].join(","));
  return `${[...names, "used", "reason"].join(",")}\n${rows.join("\n")}\n`;
}

function save(kind) {
  const run = runOf(state.a), data = state.a && samplesOf(state.a), [figure, words] = FIGURES[kind] ?? [() => true, "samples"];
  if (!data || !figure()) return note("there is nothing to save");
  const text = kind === "csv" ? csvOf(data) : standalone(figure(), `${current().name}: ${run.id}, ${words}`);
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type: kind === "csv" ? "text/csv" : "image/svg+xml" }));
  link.download = `${run.id.replace(/[^\w.-]+/g, "_")}-${words.replace(" ", "-")}.${kind === "csv" ? "csv" : "svg"}`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  get("export-menu").hidePopover();
}

async function share() {
  try {
    await navigator.clipboard.writeText(location.href);
    note("address copied: it opens this run, zoom, parameters and comparison");
  } catch {
    note("copy the address from the browser's address line");
  }
}

export function setUp() {
  for (const button of document.querySelectorAll("[data-save]")) button.addEventListener("click", () => save(button.dataset.save));
  get("share").addEventListener("click", share);
}
