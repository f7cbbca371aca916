// Orders for the selected vehicles: the buttons, each with the vehicles that it is for.

/**
 * @import { Feed } from "./feed.js"
 * @import { Orders } from "./order_sending.js"
 * @import { Selection } from "./selection.js"
 *
 * @typedef {object} Command
 * @property {string} title
 * @property {string} key
 * @property {string} style
 * @property {string} [risk] what may happen; then the user is asked
 */

import { ask } from "./dialogs.js";
import { el, setText } from "./dom.js";
import { named, vehicleName } from "./format.js";

/** @typedef {"hold" | "resume" | "return" | "arm" | "disarm" | "ready"} Action */

/** @type {Record<Action, Command>} */
const COMMANDS = {
  hold: { title: "Hold", key: "space", style: "main" },
  resume: { title: "Resume", key: "R", style: "" },
  return: {
    title: "Return",
    key: "B",
    style: "",
    risk: "They fly to their launch points and take no tasks until resumed.",
  },
  arm: { title: "Arm", key: "A", style: "danger", risk: "Propellers may turn." },
  disarm: {
    title: "Disarm",
    key: "D",
    style: "danger",
    risk: "A vehicle that may be in the air is refused.",
  },
  ready: {
    title: "Ready",
    key: "",
    style: "danger",
    risk: "Somebody has looked at them: they can fly again.",
  },
};
const MAX_NAMED = 5;

export class Commands {
  /**
   * @param {HTMLElement} root
   * @param {Feed} feed
   * @param {Selection} selection
   * @param {Orders} orders
   * @param {() => void} drawZone
   */
  constructor(root, feed, selection, orders, drawZone) {
    this.root = root;
    this.feed = feed;
    this.selection = selection;
    this.orders = orders;
    const actions = /** @type {Action[]} */ (Object.keys(COMMANDS));
    this.buttons = actions.map((action) => {
      const { title, key, style } = COMMANDS[action];
      const label = el("span", {}, title);
      const attributes = { class: style, "data-action": action, onclick: () => this.give(action) };
      const element = el("button", attributes, label, key ? el("kbd", {}, key) : null);
      return { title, label, element };
    });
    const zone = el(
      "button",
      { "data-action": "zone", onclick: drawZone },
      "No-fly zone",
      el("kbd", {}, "N"),
    );
    this.goOn = el(
      "button",
      {
        "data-action": "continue",
        title: "Send free agents to targets that need one",
        onclick: () => this.continueMission(),
      },
      "Continue mission",
    );
    const holdAll = el(
      "button",
      { class: "stop", "data-action": "hold-all", onclick: () => this.holdAll() },
      "Hold all",
      el("kbd", {}, "shift+space"),
    );
    this.others = [zone, this.goOn, holdAll];
    root.append(...this.buttons.map(({ element }) => element), zone, this.goOn, orders.result, holdAll);
    feed.onAny(["mission", "vehicles", "head"], () => this.show());
    feed.addEventListener("lost", () => this.show());
    selection.addEventListener("change", () => this.show());
    this.show();
  }

  get mayOperate() {
    return this.feed.connected && this.feed.role === "operate" && this.feed.data.mission?.kind === "live";
  }

  chosen() {
    return this.selection.among(this.feed.data.vehicles);
  }

  show() {
    const names = this.chosen().map((one) => vehicleName(one.vehicle));
    for (const { title, label, element } of this.buttons) {
      setText(label, names.length ? `${title} ${named(names, MAX_NAMED)}` : title);
      element.disabled = !this.mayOperate || !names.length;
    }
    for (const button of this.others) button.disabled = !this.mayOperate;
    this.goOn.hidden = !this.feed.data.head?.ended;
    this.root.hidden = this.feed.data.mission?.kind === "replay";
  }

  /** @param {Action} action */
  async give(action) {
    const chosen = this.chosen();
    if (this.isRefused(action)) return;
    if (!chosen.length) {
      this.orders.say(`${action}: select vehicles first (click, or their number)`, true);
      return;
    }
    const { title, risk } = COMMANDS[action];
    const names = chosen.map((one) => vehicleName(one.vehicle)).join(", ");
    const who = `${chosen.length > 1 ? "vehicles" : "vehicle"} ${names}`;
    if (risk && !(await ask(`${title} ${who}?`, risk, `${title} ${names}`))) return;
    this.orders.give(action, { vehicles: chosen.map((one) => one.vehicle) });
  }

  holdAll() {
    if (!this.isRefused("hold all")) this.orders.give("hold", { vehicles: "all" });
  }

  continueMission() {
    if (!this.isRefused("continue")) this.orders.give("continue", { vehicles: "all" });
  }

  /**
   * Say why an order is not sent: a key pressed in vain must not pass unnoticed.
   *
   * @param {string} what
   */
  isRefused(what) {
    if (this.mayOperate) return false;
    const { connected, role } = this.feed;
    const why = !connected
      ? "no connection"
      : role === "view"
        ? "this token may view only"
        : "this is a replay";
    this.orders.say(`${what}: ${why}, NOT sent`, true);
    return true;
  }
}
