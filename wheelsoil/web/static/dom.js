// Pieces of a page that are made once and filled many times. Words are text, never markup.

export const get = (id) => document.getElementById(id);
export const known = (value) => value !== null && value !== undefined;
export const spaced = (name) => name.replaceAll("_", " ");

export function write(element, words) {
  if (element.textContent !== words) element.textContent = words;
}

export function part(tag, className, words = "") {
  const made = document.createElement(tag);
  if (className) made.className = className;
  made.textContent = words;
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
