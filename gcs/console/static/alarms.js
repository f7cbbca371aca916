// Alarm banner: the worst open alarm, the number of the others, acknowledgement and sound.
// An alarm is open until it is acknowledged on this screen; a repeated one replaces the older one.

import { el } from "./dom.js";
import { duration } from "./format.js";

const MAX_ASKED = 300; // characters of a text
const LEVELS = { alarm: 2, warning: 1 };

// Proposed plans have a panel of their own, and a refused order is shown beside its button.
const isElsewhere = ({ kind, level }) =>
  kind === "Proposal" || (kind === "OrderAnswer" && level === "warning");

// Names an entry also after a replay has gone to another time, which numbers all entries anew.
const nameOf = ({ t_s: at, text }) => `${at} ${text}`;

// Link to what the alarm means and what to do.
const helpOn = ({ n, text }) =>
  el(
    "a",
    {
      href: `/alarms?about=${encodeURIComponent(text.slice(0, MAX_ASKED))}`,
      target: "_blank",
      rel: "noopener",
      "data-name": `help-${n}`,
    },
    "What to do",
  );

export class Alarms {
  constructor(root, feed, panels) {
    this.root = root;
    this.panels = panels;
    this.open = new Map();
    this.seen = 0;
    this.acknowledged = new Set();
    this.muted = localStorage.getItem("muted") === "yes";
    this.audio = null;
    feed.on(["log"], (data, fresh) => this.add(data, fresh));
    document.addEventListener("pointerdown", () => this.allowSound(), { once: true });
    document.addEventListener("keydown", () => this.allowSound(), { once: true });
    panels.addEventListener("change", () => this.show());
    this.show();
  }

  get isListed() {
    return this.panels.current === "alarms";
  }

  add(data, fresh) {
    if (fresh) this.begin(data.mission);
    let worst = 0;
    for (const entry of data.log) {
      if (entry.n <= this.seen) continue;
      this.seen = entry.n;
      if (!(entry.level in LEVELS) || isElsewhere(entry) || this.acknowledged.has(nameOf(entry))) continue;
      this.open.set(`${entry.vehicle} ${entry.text.replace(/[\d.,]+/g, "#")}`, entry);
      worst = Math.max(worst, LEVELS[entry.level]);
    }
    if (worst && !fresh) this.sound(worst);
    this.show(worst > 0 && !fresh);
  }

  // A new run, or the same one after a lost connection.
  begin(mission) {
    this.store = `acknowledged ${mission.name} ${mission.begun}`;
    this.acknowledged = new Set(JSON.parse(sessionStorage.getItem(this.store) ?? "[]"));
    this.open.clear();
    this.seen = 0;
  }

  sorted() {
    return [...this.open.values()].sort((a, b) => LEVELS[b.level] - LEVELS[a.level] || b.n - a.n);
  }

  acknowledge(entries) {
    const numbers = new Set(entries.map((entry) => entry.n));
    for (const [key, entry] of this.open) {
      if (numbers.has(entry.n)) this.open.delete(key);
    }
    for (const entry of entries) this.acknowledged.add(nameOf(entry));
    if (this.store) sessionStorage.setItem(this.store, JSON.stringify([...this.acknowledged]));
    if (!this.open.size && this.isListed) this.panels.show("targets");
    this.show();
  }

  acknowledgeWorst() {
    this.acknowledge(this.sorted().slice(0, 1));
  }

  show(isNew = false) {
    const entries = this.sorted();
    const worst = entries[0];
    const list = this.panels.roots.alarms;
    const parts = [this.root, list];
    const focused = parts.some((one) => one.contains(document.activeElement))
      ? document.activeElement.dataset.name
      : null;
    const button = (name, text, action, more = {}) =>
      el("button", { "data-name": name, onclick: action, ...more }, text);
    const bar = el(
      "div",
      { class: `bar ${worst ? worst.level : "quiet"}${isNew ? " new" : ""}` },
      el(
        "span",
        { class: "text", title: worst?.text },
        worst ? `${duration(worst.t_s)}  ${worst.text}` : "No open alarm",
      ),
    );
    if (worst) {
      bar.append(helpOn(worst));
      const more = el(
        "button",
        {
          "data-name": "more",
          "aria-expanded": String(this.isListed),
          onclick: () => this.panels.toggle("alarms"),
        },
        `${entries.length} open`,
      );
      const acknowledge = button("acknowledge", "Acknowledge", () => this.acknowledge([worst]));
      acknowledge.append(el("kbd", {}, "K"));
      bar.append(more, acknowledge);
    }
    bar.append(
      button("mute", this.muted ? "Sound off" : "Sound on", () => this.mute(), {
        "aria-pressed": String(!this.muted),
        title: "Sound of alarms",
      }),
    );
    this.root.replaceChildren(bar);
    list.replaceChildren(...(this.isListed ? [this.list(entries, button)] : []));
    this.panels.count("alarms", entries.length);
    if (focused)
      parts
        .map((one) => one.querySelector(`[data-name="${focused}"]`))
        .find(Boolean)
        ?.focus();
  }

  list(entries, button) {
    const rows = entries.map((entry) =>
      el(
        "li",
        { class: entry.level },
        el("span", { class: "text" }, `${duration(entry.t_s)}  ${entry.text}`),
        helpOn(entry),
        button(`one-${entry.n}`, "Acknowledge", () => this.acknowledge([entry])),
      ),
    );
    if (!entries.length) return el("p", { class: "empty" }, "No open alarm.");
    const all = el(
      "li",
      {},
      el("span", { class: "text" }),
      button("all", "Acknowledge all", () => this.acknowledge(entries)),
    );
    return el("ul", {}, all, ...rows);
  }

  mute() {
    this.muted = !this.muted;
    localStorage.setItem("muted", this.muted ? "yes" : "no");
    this.show();
  }

  // Browsers play no sound before the user has touched the page.
  allowSound() {
    this.audio ??= new AudioContext();
  }

  sound(level) {
    if (this.muted || !this.audio) return;
    const start = this.audio.currentTime;
    for (let beep = 0; beep < level; beep++) {
      const tone = new OscillatorNode(this.audio, { frequency: level === 2 ? 880 : 560 });
      const gain = new GainNode(this.audio, { gain: 0.08 });
      tone.connect(gain).connect(this.audio.destination);
      tone.start(start + beep * 0.22);
      tone.stop(start + beep * 0.22 + 0.14);
    }
  }
}
