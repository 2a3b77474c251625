// A button that starts a job, and while it runs shows its time and cancels it.

import { ask } from "./api.js";
import { took } from "./choice.js";
import { part } from "./dom.js";
import { during } from "./talk.js";

export class Job {
  constructor(button, start) {
    this.button = button;
    this.words = [...button.childNodes];
    this.campaign = null; // the one it runs for
    button.addEventListener("click", () => (this.campaign ? this.cancel() : start()));
  }

  /** Show that it runs for a campaign until the promise is settled; the promise's value. */
  async run(campaign, promise) {
    this.begin(campaign);
    try {
      return await promise;
    } finally {
      this.end();
    }
  }

  begin(campaign) {
    if (this.campaign) return;
    this.campaign = campaign;
    this.cancelled = false;
    const since = performance.now(), seconds = part("span", "number"), name = this.words[0].textContent; // without the key behind it
    const tick = () => { seconds.textContent = `${Math.floor((performance.now() - since) / 1000)} s`; };
    tick();
    this.timer = setInterval(tick, 500);
    this.button.classList.add("running");
    this.button.replaceChildren(`Cancel `, seconds);
    this.button.setAttribute("aria-label", `Cancel: ${name}`);
  }

  end() {
    clearInterval(this.timer);
    this.campaign = null;
    this.button.classList.remove("running");
    this.button.replaceChildren(...this.words);
    this.button.removeAttribute("aria-label");
  }

  async cancel() {
    this.cancelled = true;
    const entry = await during("cancelling", ask("/api/cancel", { campaign: this.campaign }));
    if (entry) took(entry);
  }

  /** A job that was cancelled here has not gone wrong. */
  pardon(error) {
    if (!this.cancelled) throw error;
    return undefined;
  }
}
