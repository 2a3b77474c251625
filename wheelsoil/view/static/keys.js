// Shortcuts, and the list of them.

import { play, step } from "./cursor.js";
import { get, part } from "./dom.js";
import { redo, undo } from "./history.js";
import { pickNext } from "./list.js";
import { setMark } from "./marks.js";
import { zoomTo } from "./rows.js";
import { select, stretch } from "./selection.js";
import { samplesOf } from "./samples.js";
import { state } from "./store.js";

const zoomIn = () => state.selection?.kind === "time" && zoomTo([state.selection.from, state.selection.to]);
const press = (id) => () => { if (!get(id).hidden && !get(id).disabled && !get("bar").hidden) get(id).click(); };

function clear() {
  if (state.selection) select(null);
  else zoomTo(null);
}

/** Move what is zoomed by a quarter of itself. */
function pan(way) {
  if (!state.zoom) return;
  const [from, to] = state.zoom, end = samplesOf(state.a)?.time_s.at(-1) ?? to, by = Math.max(-from, Math.min(end - to, (way * (to - from)) / 4));
  zoomTo([from + by, to + by]);
}

const KEYS = [
  ["j", "J", "next run", () => pickNext(1)], ["k", "K", "previous run", () => pickNext(-1)],
  [" ", "Space", "play the cursor, stop", play],
  ["ArrowLeft", "← →", "cursor by 0.1 s, with Alt by 1 s", (event) => step(event.altKey ? -1 : -0.1)], ["ArrowRight", "", "", (event) => step(event.altKey ? 1 : 0.1)],
  ["Shift+ArrowLeft", "Shift ← →", "stretch the selection by 0.5 s", () => stretch(-0.5)], ["Shift+ArrowRight", "", "", () => stretch(0.5)],
  ["z", "Z", "zoom to the selection", zoomIn], [",", ", .", "move what is zoomed", () => pan(-1)], [".", "", "", () => pan(1)],
  ["Escape", "Esc", "clear the selection, then the zoom", clear],
  ["e", "E", "exclude the selection", press("leave-out")], ["f", "F", "fit only the selection", press("keep-only")], ["m", "M", "mark at the cursor or the selection", setMark],
  ["r", "R", "refit", () => get("refit").click()], ["d", "D", "diagnose", () => get("diagnose").click()],
  ["/", "/", "add an effect", () => get("effect-picker").querySelector("input").focus()], ["s", "S", "add a signal", () => get("signal-menu").showPopover()],
  ["Ctrl+z", "Ctrl Z", "undo", undo], ["Ctrl+Shift+z", "Ctrl Shift Z", "redo", redo], ["Ctrl+y", "", "", redo],
  ["?", "?", "this list", () => get("shortcuts").togglePopover()],
];

const isTyping = ({ tagName, type }) => tagName === "TEXTAREA" || tagName === "SELECT" || (tagName === "INPUT" && !["checkbox", "radio"].includes(type));

function nameOf(event) {
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key, shift = event.shiftKey && (key.length > 1 || /[a-z]/.test(key));
  return `${event.ctrlKey || event.metaKey ? "Ctrl+" : ""}${shift ? "Shift+" : ""}${key}`;
}

function take(event) {
  const name = nameOf(event), found = KEYS.find(([key]) => key === name), { target } = event;
  if (!found || event.defaultPrevented) return;
  if (isTyping(target) && name !== "Escape") return;
  if (name === "Escape" && (isTyping(target) || document.querySelector(".menu:popover-open"))) return target.blur();
  if ([" ", "ArrowLeft", "ArrowRight"].includes(name) && ["BUTTON", "SUMMARY", "INPUT"].includes(target.tagName) && !target.classList.contains("run")) return; // they press it, or choose
  event.preventDefault();
  found[3](event);
}

export function setUp() {
  document.addEventListener("keydown", take);
  get("zoom").addEventListener("click", zoomIn);
  get("keys").append(...KEYS.filter(([, shown]) => shown).flatMap(([, shown, words]) => {
    const key = part("dt");
    key.append(...shown.split(" ").map((each) => part("kbd", "", each)));
    return [key, part("dd", "", words)];
  }));
}
