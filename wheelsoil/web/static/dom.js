// Pieces of a page that are made once and filled many times. Words are text, never markup.

export const get = (id) => document.getElementById(id);
export const known = (value) => value !== null && value !== undefined;
export const spaced = (name) => name.replaceAll("_", " ");

const TURNING = "\\u0590-\\u08ff\\u200e\\u200f\\u202a-\\u202e\\u2066-\\u2069\\ufb1d-\\ufdff\\ufe70-\\ufefc", TURNED = `[^\\s${TURNING}]*[${TURNING}]\\S*`;
const TURNS = new RegExp(`(${TURNED}(?:\\s+${TURNED})*)`);

export function write(element, words) {
  if (element.textContent !== words) fill(element, words);
}

/** Words that turn the direction of writing are isolated, so that the rest reads as it is; see web/bidi.py. */
function fill(element, words) {
  if (!TURNS.test(words) || element instanceof SVGElement) element.textContent = words;
  else element.replaceChildren(...words.split(TURNS).map((each, i) => (i % 2 ? part("bdi", "", each) : each)));
}

export function part(tag, className, words = "") {
  const made = document.createElement(tag);
  if (className) made.className = className;
  if (tag === "bdi") made.textContent = words;
  else fill(made, words);
  return made;
}

/** Keep one child per item, in order; make it once and fill it each time. */
export function list(parent, items, make, fill) {
  while (parent.children.length > items.length) parent.lastElementChild.remove();
  items.forEach((item, i) => fill(parent.children[i] ?? parent.appendChild(make()), item));
}

/** Have these children, in order. One that stands in its place is not touched: it keeps the focus and what is typed in it. */
export function place(parent, children) {
  for (const child of [...parent.children]) if (!children.includes(child)) child.remove();
  children.forEach((child, i) => {
    if (parent.children[i] !== child) parent.insertBefore(child, parent.children[i] ?? null);
  });
}

/** Facts are [name, text, level, wide]. */
export function facts(parent, items) {
  const make = () => {
    const box = document.createElement("div");
    box.append(part("dt"), part("dd"));
    return box;
  };
  list(parent, items, make, (box, [name, words, level, wide]) => {
    box.dataset.level = level ?? "";
    box.className = wide ? "wide" : "";
    write(box.children[0], name);
    write(box.children[1], words);
  });
}
