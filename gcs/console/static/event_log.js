// Panel with the log: events of the run, those that are warnings or alarms, and orders with their answers.

/**
 * @import { LogEntry } from "../page_types.d.ts"
 * @import { Feed } from "./feed.js"
 */

import { el, setText } from "./dom.js";
import { duration } from "./format.js";

const MAX_SHOWN = 300;
const NEAR_END_PX = 30;

class LogPanel {
  /**
   * @param {string} title
   * @param {() => void} choose
   */
  constructor(title, choose) {
    this.list = el("ol");
    this.tab = el("button", { role: "tab", onclick: choose }, title);
    const attributes = { class: "panel", role: "tabpanel", tabindex: 0, "aria-label": title };
    this.panel = el("div", attributes, this.list);
    /** True until the user scrolls back. */
    this.isAtEnd = true;
    this.panel.addEventListener("scroll", () => {
      const { scrollHeight, scrollTop, clientHeight } = this.panel;
      this.isAtEnd = scrollHeight - scrollTop - clientHeight < NEAR_END_PX;
    });
    const resized = new ResizeObserver(() => this.followEnd());
    resized.observe(this.panel);
    resized.observe(this.list);
  }

  followEnd() {
    if (this.isAtEnd) this.panel.scrollTop = this.panel.scrollHeight;
  }

  /** @param {boolean} isShown */
  show(isShown) {
    this.panel.hidden = !isShown;
    this.tab.setAttribute("aria-selected", String(isShown));
    this.isAtEnd = true;
    this.followEnd();
  }

  /**
   * Append entries; the end stays in view if it is.
   *
   * @param {LogEntry[]} entries
   * @param {boolean} isFresh
   */
  append(entries, isFresh) {
    const { list } = this;
    if (isFresh) {
      list.replaceChildren();
      this.isAtEnd = true;
    }
    list.append(
      ...entries.map(({ t_s: at, level, text }) =>
        el("li", { class: level }, el("time", {}, duration(at)), el("span", {}, text)),
      ),
    );
    while (list.childElementCount > MAX_SHOWN) list.firstElementChild?.remove();
    this.followEnd();
  }
}

/**
 * @param {HTMLElement} root
 * @param {Feed} feed
 */
export function showLog(root, feed) {
  /** @param {LogPanel} chosen */
  const choose = (chosen) => {
    for (const one of panels) one.show(one === chosen);
  };
  const events = new LogPanel("Events", () => choose(events));
  const warnings = new LogPanel("Warnings", () => choose(warnings));
  const orders = new LogPanel("Orders", () => choose(orders));
  const panels = [events, warnings, orders];
  const tabs = el("div", { class: "tabs", role: "tablist" }, ...panels.map((one) => one.tab));
  root.append(tabs, ...panels.map((one) => one.panel));
  choose(events);

  let last = 0;
  feed.on("log", (log, isFresh) => {
    if (isFresh) last = 0;
    const entries = log.filter((entry) => entry.n > last);
    last = log.at(-1)?.n ?? last;
    const others = entries.filter((entry) => entry.kind !== "OrderAnswer");
    events.append(others, isFresh);
    warnings.append(
      others.filter((entry) => entry.level !== "info"),
      isFresh,
    );
    orders.append(
      entries.filter((entry) => entry.kind === "OrderAnswer"),
      isFresh,
    );
    const count = orders.list.childElementCount;
    setText(orders.tab, count ? `Orders (${count})` : "Orders");
  });
}
