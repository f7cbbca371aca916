// Freshness of the data: what the page says when updates stop, since a lost service must not look living.

/** @import { Feed } from "./feed.js" */

import { el, setText } from "./dom.js";
import { seconds, utc } from "./format.js";

const SILENT_MS = 2500;
const PERIOD_MS = 1000;

/** Dispatches "change" once a second, and as soon as something changes. */
export class Freshness extends EventTarget {
  /** @param {Feed} feed */
  constructor(feed) {
    super();
    this.feed = feed;
    /** Empty while the data is fresh. */
    this.problem = "";
    feed.addEventListener("lost", () => this.check());
    feed.onData((names) => {
      if (this.problem || names.has("lost")) this.check();
    });
    setInterval(() => this.check(), PERIOD_MS);
  }

  check() {
    const { connected, heardAt, data } = this.feed;
    const isSilent = Date.now() - heardAt > SILENT_MS && data.mission?.kind === "live";
    if (!connected) this.problem = "no connection";
    else if (data.lost) this.problem = "the service does not answer";
    else this.problem = isSilent ? "no data" : "";
    this.dispatchEvent(new Event("change"));
  }

  /** When the data was new, in milliseconds since 1970; 0 if there was none. */
  get dataAt() {
    return this.feed.data.lost ?? this.feed.heardAt;
  }

  /** Time of the last data, UTC; empty if there was none. */
  get since() {
    return this.dataAt ? utc(this.dataAt) : "";
  }

  get age() {
    return seconds((Date.now() - this.dataAt) / 1000);
  }
}

/**
 * Say over the map that its data is old; the map turns grey.
 *
 * @param {HTMLElement} root
 * @param {Freshness} freshness
 */
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
