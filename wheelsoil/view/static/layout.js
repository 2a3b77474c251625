// What is shown: rows, channels of the cross plot, colours of the other runs; layouts that this browser keeps.

import { CHANNELS, capital, ROWS } from "./channels.js";
import { get, list, part, write } from "./dom.js";
import { Picker } from "./picker.js";
import { rowOf, rowsShown } from "./rows.js";
import { namesOf, toggleRow } from "./signals.js";
import { on, state, tell } from "./store.js";
import { note } from "./talk.js";

const PLACE = "wheelsoil view layouts";
let signals = []; // of the run that is looked at
let picker;

const shownKeys = () => rowsShown().map(({ key }) => key);
const layoutNow = () => ({ rows: state.rows, cross: state.cross, colour: state.colour, part: state.part });

function saved() {
  try { return JSON.parse(localStorage.getItem(PLACE) ?? "{}"); } catch { return {}; }
}

function keep(layouts) {
  try { localStorage.setItem(PLACE, JSON.stringify(layouts)); } catch { note("this browser keeps no layouts"); }
  show();
}

/** Rows, cross plot and colours as they were; what is not known is left out. */
export function setLayout({ rows, cross, colour, part: seen }) {
  const known = (key) => CHANNELS.some((each) => each.key === key);
  state.rows = Array.isArray(rows) ? rows.filter((key) => typeof key === "string" && rowOf(key)) : null;
  if (known(cross?.x) && known(cross?.y)) state.cross = { ...cross };
  if (["density", "load", "speed", "pass", "none"].includes(colour)) state.colour = colour;
  if (["driving", "braking", "all"].includes(seen)) state.part = seen;
  tell("shown");
}

function showRows() {
  const own = (state.rows ?? []).filter((key) => key.startsWith("signal:")).map(rowOf), keys = shownKeys();
  list(get("row-list"), [...ROWS, ...own], () => {
    const label = part("label", "check"), input = part("input");
    input.type = "checkbox";
    label.append(input, part("span"));
    return label;
  }, (label, { key, title }) => {
    const [input, words] = label.children;
    input.checked = keys.includes(key);
    write(words, title);
    input.onchange = () => toggleRow(key, input.checked, keys);
  });
}

function show() {
  showRows();
  for (const axis of ["x", "y"]) get(`cross-${axis}`).value = state.cross[axis];
  get("colour").value = state.colour;
  get("colours").hidden = ["density", "none"].includes(state.colour);
  list(get("layouts"), Object.entries(saved()), () => {
    const item = part("li"), take = part("button"), away = part("button", "icon", "✕");
    take.type = away.type = "button";
    item.append(take, away);
    return item;
  }, (item, [name, layout]) => {
    const [take, away] = item.children;
    write(take, name);
    away.setAttribute("aria-label", `Forget the layout ${name}`);
    take.onclick = () => setLayout(layout);
    away.onclick = () => keep(Object.fromEntries(Object.entries(saved()).filter(([each]) => each !== name)));
  });
}

/** A menu opens under its button, within the window. */
function unfold(menu) {
  const button = document.querySelector(`[popovertarget=${menu.id}]`);
  menu.addEventListener("beforetoggle", (event) => {
    if (event.newState !== "open") return;
    const { left, bottom } = button.getBoundingClientRect();
    menu.style.setProperty("top", `${bottom + 4}px`);
    menu.style.setProperty("left", `${Math.max(8, Math.min(left, innerWidth - (menu.id === "shortcuts" ? 396 : 336)))}px`);
  });
  return menu;
}

export function setUp() {
  for (const axis of ["x", "y"]) {
    get(`cross-${axis}`).replaceChildren(...CHANNELS.map(({ key, name }) => Object.assign(part("option", "", capital(name)), { value: key })));
    get(`cross-${axis}`).addEventListener("change", () => {
      state.cross = { ...state.cross, [axis]: get(`cross-${axis}`).value };
      tell("shown");
    });
  }
  get("colour").addEventListener("change", () => {
    state.colour = get("colour").value;
    tell("shown");
  });
  get("layout-form").addEventListener("submit", (event) => {
    event.preventDefault();
    keep({ ...saved(), [get("layout-name").value.trim()]: layoutNow() });
    get("layout-name").value = "";
  });
  const options = () => [...ROWS.filter(({ key }) => !shownKeys().includes(key)).map(({ key, title }) => ({ key, name: title })), ...signals.filter(({ name }) => !shownKeys().includes(`signal:${name}`)).map(({ name, unit }) => ({ key: `signal:${name}`, name: name.replace(/^\S* /, ""), note: unit, more: name.includes(" ") ? name.split(" ")[0] : "" }))];
  picker = new Picker(get("signal-picker"), "Search signals", { options, take: ({ key }) => { toggleRow(key, true, shownKeys()); get("signal-menu").hidePopover(); }, most: 12, open: true });
  for (const menu of document.querySelectorAll(".menu")) unfold(menu);
  get("signal-menu").addEventListener("toggle", async (event) => {
    if (event.newState !== "open") return;
    picker.input.focus();
    picker.show();
    signals = state.a ? await namesOf({ ...state.a }) : [];
    picker.show();
  });
  on("picked", () => { signals = []; });
  on("shown picked data", show);
}
