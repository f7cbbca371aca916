// Alarms: the bar with the worst open one, and the panel with all.

/**
 * @import { LogEntry } from "../page_types.d.ts"
 * @import { Feed } from "./feed.js"
 * @import { Panels } from "./panels.js"
 */

import { AlarmSound } from "./alarm_sound.js";
import { el } from "./dom.js";
import { duration } from "./format.js";
import { OpenAlarms } from "./open_alarms.js";

export class Alarms {
  /**
   * @param {HTMLElement} root
   * @param {Feed} feed
   * @param {Panels} panels
   */
  constructor(root, feed, panels) {
    this.root = root;
    this.panels = panels;
    this.alarms = new OpenAlarms(sessionStorage);
    this.sound = new AlarmSound();
    feed.on("log", (log, isFresh) => {
      const { mission } = feed.data;
      if (isFresh) this.alarms.begin(`${mission?.name} ${mission?.begun}`);
      const worst = this.alarms.add(log);
      const isNew = worst > 0 && !isFresh;
      if (isNew) this.sound.play(worst);
      this.show(isNew);
    });
    panels.addEventListener("change", () => this.show());
    this.show();
  }

  get isListed() {
    return this.panels.current === "alarms";
  }

  /** @param {LogEntry[]} entries */
  acknowledge(entries) {
    this.alarms.acknowledge(entries);
    if (!this.alarms.open.size && this.isListed) this.panels.show("targets");
    this.show();
  }

  acknowledgeWorst() {
    this.acknowledge(this.alarms.sorted().slice(0, 1));
  }

  mute() {
    this.sound.toggle();
    this.show();
  }

  /** Show the bar and the list; the focus stays on the button of the same name. */
  show(isNew = false) {
    const entries = this.alarms.sorted();
    const list = this.panels.roots.alarms;
    const focused = [this.root, list].flatMap(focusedName)[0];
    this.root.replaceChildren(this.bar(entries, isNew));
    list.replaceChildren(...(this.isListed ? [this.list(entries)] : []));
    this.panels.count("alarms", entries.length);
    if (!focused) return;
    const again = [this.root, list].flatMap((part) => [...part.querySelectorAll("[data-name]")]);
    const button = again.find((one) => one instanceof HTMLElement && one.dataset.name === focused);
    if (button instanceof HTMLElement) button.focus();
  }

  /**
   * @param {LogEntry[]} entries
   * @param {boolean} isNew
   */
  bar(entries, isNew) {
    const [worst] = entries;
    const text = worst ? lineOf(worst) : "No open alarm";
    const style = `bar ${worst ? worst.level : "quiet"}${isNew ? " new" : ""}`;
    const bar = el("div", { class: style }, el("span", { class: "text", title: worst?.text }, text));
    if (worst) bar.append(helpOn(worst), ...this.worstButtons(worst, entries.length));
    const mute = button("mute", this.sound.isMuted ? "Sound off" : "Sound on", () => this.mute());
    mute.setAttribute("aria-pressed", String(!this.sound.isMuted));
    mute.title = "Sound of alarms";
    bar.append(mute);
    return bar;
  }

  /**
   * @param {LogEntry} worst
   * @param {number} count
   */
  worstButtons(worst, count) {
    const more = button("more", `${count} open`, () => this.panels.toggle("alarms"));
    more.setAttribute("aria-expanded", String(this.isListed));
    const acknowledge = button("acknowledge", "Acknowledge", () => this.acknowledge([worst]));
    acknowledge.append(el("kbd", {}, "K"));
    return [more, acknowledge];
  }

  /** @param {LogEntry[]} entries */
  list(entries) {
    if (!entries.length) return el("p", { class: "empty" }, "No open alarm.");
    const rows = entries.map((entry) =>
      el(
        "li",
        { class: entry.level },
        el("span", { class: "text" }, lineOf(entry)),
        helpOn(entry),
        button(`one-${entry.n}`, "Acknowledge", () => this.acknowledge([entry])),
      ),
    );
    const all = button("all", "Acknowledge all", () => this.acknowledge(entries));
    return el("ul", {}, el("li", {}, el("span", { class: "text" }), all), ...rows);
  }
}

/** @param {LogEntry} entry */
function lineOf({ t_s: at, text }) {
  return `${duration(at)}  ${text}`;
}

/**
 * Return the link to what an alarm means and what to do.
 *
 * @param {LogEntry} entry
 */
function helpOn({ n, code }) {
  const attributes = { href: `/alarms#${code}`, target: "_blank", rel: "noopener", "data-name": `help-${n}` };
  return el("a", attributes, "What to do");
}

/**
 * @param {string} name keeps the focus when the button is made anew
 * @param {string} text
 * @param {() => void} action
 */
function button(name, text, action) {
  return el("button", { "data-name": name, onclick: action }, text);
}

/** @param {HTMLElement} part */
function focusedName(part) {
  const { activeElement: active } = document;
  return active instanceof HTMLElement && part.contains(active) ? (active.dataset.name ?? []) : [];
}
