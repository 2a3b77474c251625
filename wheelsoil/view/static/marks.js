// Marks at moments of a run: those of the field, and those set here, which the choice keeps; and the comment.

import { change } from "./choice.js";
import { get, list, part, write } from "./dom.js";
import { fixed } from "./channels.js";
import { setCursor } from "./cursor.js";
import { chosenRun, entryOf, samplesOf } from "./samples.js";
import { choiceOf, on, runOf, state } from "./store.js";

/** Marks of a run, in order: { at_s, text, ours }. */
export function marksOf(place) {
  const run = runOf(place), data = place && samplesOf(place);
  const ours = (run && chosenRun(place.campaign, run)?.marks) ?? [];
  return [...(data?.marks ?? []), ...ours.map((mark) => ({ ...mark, ours: true }))].sort((a, b) => a.at_s - b.at_s);
}

/** Set a mark where the selection begins, or at the cursor. */
export function setMark() {
  const run = runOf(state.a), at = state.selection?.kind === "time" ? state.selection.from : state.cursor;
  if (!run || at === null) return;
  const mark = { at_s: Math.max(0, Math.round(at * 100) / 100), text: "mark" };
  edit(run, (marks) => [...marks, mark]);
  get("marks").dataset.focus = String(mark.at_s); // its text is typed next
}

function edit(run, how) {
  change(state.a.campaign, (choice) => {
    const entry = entryOf(choice, run), marks = how(entry.marks ?? []);
    delete entry.marks;
    if (marks.length) entry.marks = marks;
  });
}

function make() {
  const item = part("li"), at = part("button", "link"), words = part("input"), away = part("button", "icon", "✕");
  for (const button of [at, away]) button.type = "button";
  words.maxLength = 200;
  words.setAttribute("aria-label", "Text of the mark");
  away.setAttribute("aria-label", "Remove the mark");
  item.append(at, words, away);
  return item;
}

function show() {
  const run = runOf(state.a), comment = choiceOf(state.a?.campaign).comment ?? "";
  if (document.activeElement !== get("comment")) get("comment").value = comment;
  list(get("marks"), run ? marksOf(state.a) : [], make, (item, { at_s: at, text, ours }) => {
    const [moment, words, away] = item.children, same = (mark) => mark.at_s === at;
    write(moment, `${fixed(at, 1)} s`);
    if (document.activeElement !== words) words.value = text;
    words.disabled = away.hidden = !ours;
    moment.onclick = () => setCursor(at);
    words.onchange = () => {
      const typed = words.value;
      edit(run, (marks) => marks.map((mark) => (same(mark) ? { ...mark, text: typed } : mark)));
    };
    away.onclick = () => edit(run, (marks) => marks.filter((mark) => !same(mark)));
    if (get("marks").dataset.focus === String(at)) {
      delete get("marks").dataset.focus;
      words.focus();
      words.select();
    }
  });
}

export function setUp() {
  get("comment").addEventListener("change", () => {
    const words = get("comment").value.trim();
    change(state.a.campaign, (choice) => {
      if (words) choice.comment = words;
      else delete choice.comment;
    });
  });
  get("mark").addEventListener("click", setMark);
  on("list picked data", show);
}
