// Save: the choice as a file, and the commands that do by it what was done by hand.

import { ask } from "./api.js";
import { confirmed, took } from "./choice.js";
import { get, list, part, write } from "./dom.js";
import { current, on } from "./store.js";
import { during } from "./talk.js";

async function save() {
  const body = { campaign: current().key, name: get("save-name").value.trim(), replace: get("replace").checked };
  get("replace").checked = false;
  if (!(await confirmed())) return;
  const told = await during("saving the choice", ask("/api/save", body));
  get("replace-box").hidden = Boolean(told);
  if (told) took(told.campaign);
}

function show() {
  const campaign = current(), at = campaign?.saved_at;
  get("save").disabled = !campaign;
  write(get("saved"), at ? `Saved: ${at}` : "");
  write(get("saved-hint"), at ? "saved" : "not saved");
  const make = () => {
    const item = part("li"), button = part("button", "copy", "Copy");
    button.type = "button";
    item.append(part("code"), button);
    return item;
  };
  list(get("commands"), campaign?.commands ?? [], make, (item, line) => {
    const [code, button] = item.children;
    write(code, line);
    button.onclick = () => copy(code, button, line);
  });
}

async function copy(code, button, line) {
  getSelection().selectAllChildren(code);
  try {
    await navigator.clipboard.writeText(line);
    write(button, "Copied");
  } catch {
    write(button, "Selected: Ctrl-C");
  }
  setTimeout(() => write(button, "Copy"), 2500);
}

export function setUp() {
  get("save-form").addEventListener("submit", (event) => {
    event.preventDefault();
    save();
  });
  on("list picked", show);
}
