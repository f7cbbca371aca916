// Whether what is shown is fresh: a lost service must not look like a living one.

import { el, setText } from "./dom.js";
import { seconds } from "./format.js";

const SILENT_MS = 2500;
const PERIOD_MS = 1000;

export class Freshness extends EventTarget {
  constructor(feed) {
    super();
    this.feed = feed;
    feed.addEventListener("lost", () => this.check());
    feed.addEventListener("data", () => {
      if (this.problem) this.check();
    });
    setInterval(() => this.check(), PERIOD_MS);
    this.problem = "";
  }

  check() {
    const { connected, heardAt, data } = this.feed;
    const isSilent = Date.now() - heardAt > SILENT_MS && data.mission?.kind === "live";
    this.problem = !connected ? "no connection" : isSilent ? "no data" : "";
    this.dispatchEvent(new Event("change"));
  }

  // Time of the last data, UTC; empty if there was none.
  get since() {
    return this.feed.heardAt ? new Date(this.feed.heardAt).toISOString().slice(11, 19) : "";
  }

  get age() {
    return seconds((Date.now() - this.feed.heardAt) / 1000);
  }
}

// Says so over the map, which turns grey.
export function showOld(root, freshness) {
  const title = el("strong");
  const text = el("span");
  const banner = el("div", { class: "old", role: "alert", hidden: true }, title, text);
  root.append(banner);
  freshness.addEventListener("change", () => {
    const { problem, since, age } = freshness;
    const isOld = Boolean(problem && since);
    banner.hidden = !isOld;
    document.documentElement.classList.toggle("is-old", isOld);
    if (!isOld) return;
    setText(title, problem.toUpperCase());
    setText(text, `The last data is of ${since} UTC, ${age} ago. The vehicles are elsewhere by now.`);
  });
}
