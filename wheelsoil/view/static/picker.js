// A searchable list: typing narrows it, arrow keys and Enter take one.

import { list, part, write } from "./dom.js";

/**
 * Make a picker in a box. `options()` gives [{ key, name, note, more, off }], the likeliest first; `take(option)` gets the one that is taken.
 */
export class Picker {
  constructor(box, label, { options, take, most = 8, open = false }) {
    Object.assign(this, { box, options, take, most, open, active: 0, shown: [] });
    this.input = part("input");
    this.input.type = "search";
    this.input.placeholder = "type to search";
    this.list = part("ul", "options");
    this.list.id = `${box.id}-options`;
    this.list.setAttribute("role", "listbox");
    for (const [name, value] of Object.entries({ role: "combobox", "aria-label": label, "aria-controls": this.list.id, "aria-autocomplete": "list", autocomplete: "off" })) this.input.setAttribute(name, value);
    box.classList.add("picker");
    box.append(this.input, this.list);
    this.input.addEventListener("input", () => { this.active = 0; this.show(); });
    this.input.addEventListener("focus", () => this.show());
    this.input.addEventListener("blur", () => { if (!this.open) this.list.hidden = true; });
    this.input.addEventListener("keydown", (event) => this.key(event));
    this.list.hidden = !open;
    this.list.addEventListener("pointerdown", (event) => event.preventDefault()); // the focus stays in the box
  }

  found() {
    const words = this.input.value.trim().toLowerCase().split(/\s+/), matches = ({ key, name, note = "" }) => words.every((word) => `${key} ${name} ${note}`.toLowerCase().includes(word));
    return this.options().filter(matches);
  }

  show() {
    const found = this.found();
    this.shown = found.slice(0, this.input.value.trim() ? 40 : this.most);
    this.list.hidden = !this.open && document.activeElement !== this.input;
    this.input.setAttribute("aria-expanded", String(!this.list.hidden));
    list(this.list, this.shown, () => {
      const item = part("li", "option");
      item.setAttribute("role", "option");
      item.append(part("b"), part("span", "number"), part("small"));
      return item;
    }, (item, option) => {
      const [name, note, more] = item.children, on = this.shown[this.active] === option;
      this.emphasise(name, option.name);
      write(note, option.note ?? "");
      write(more, option.more ?? "");
      item.dataset.key = option.key;
      item.setAttribute("aria-selected", String(on));
      item.setAttribute("aria-disabled", String(Boolean(option.off)));
      item.onclick = () => this.choose(option);
    });
    if (!this.list.hidden) this.list.children[this.active]?.scrollIntoView({ block: "nearest" });
  }

  /** The words with what was typed in them marked. */
  emphasise(element, words) {
    const typed = this.input.value.trim().toLowerCase(), at = typed ? words.toLowerCase().indexOf(typed) : -1;
    if (at < 0) return write(element, words);
    element.replaceChildren(words.slice(0, at), part("mark", "", words.slice(at, at + typed.length)), words.slice(at + typed.length));
  }

  key(event) {
    const move = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (move) {
      event.preventDefault();
      this.active = Math.max(0, Math.min(this.shown.length - 1, this.active + move));
      this.show();
    } else if (event.key === "Enter") {
      event.preventDefault();
      if (this.shown[this.active]) this.choose(this.shown[this.active]);
    } else if (event.key === "Escape" && this.input.value) {
      event.stopPropagation();
      this.input.value = "";
      this.show();
    }
  }

  choose(option) {
    if (option.off) return;
    this.input.value = "";
    this.active = 0;
    this.take(option);
    this.show();
    this.list.hidden = !this.open; // until somebody types again
  }
}
