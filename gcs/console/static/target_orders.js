// Orders about the selected target: ignore or attend, priority, pin and unpin vehicles.

/**
 * @import { Commands } from "./vehicle_orders.js"
 * @import { Feed } from "./feed.js"
 * @import { Orders } from "./order_sending.js"
 * @import { Selection } from "./selection.js"
 */

import { el, setText } from "./dom.js";
import { number, targetName, vehicleName } from "./format.js";

const MAX_PRIORITY = 9;

export class TargetOrders {
  /**
   * @param {HTMLElement} root
   * @param {Feed} feed
   * @param {Selection} selection
   * @param {Orders} orders
   * @param {Commands} commands
   */
  constructor(root, feed, selection, orders, commands) {
    this.root = root;
    this.feed = feed;
    this.selection = selection;
    this.orders = orders;
    this.commands = commands;
    /**
     * Priority just ordered, until the feed shows it.
     *
     * @type {number | null}
     */
    this.wished = null;
    this.about = el("strong");
    this.ignoreButton = new LabelledButton("I", () => this.toggleIgnored());
    this.pinButton = new LabelledButton("P", () => this.pin());
    this.unpinButton = new LabelledButton("U", () => this.unpin());
    this.priority = this.choiceOfPriority();
    root.append(
      this.about,
      this.ignoreButton.element,
      el("label", {}, "Priority", this.priority),
      this.pinButton.element,
      this.unpinButton.element,
      el("span", { class: "space" }),
      el("button", { title: "Select no target", onclick: () => selection.setTarget(null) }, "Close"),
    );
    feed.onAny(["targets", "vehicles", "mission"], () => this.show());
    feed.addEventListener("lost", () => this.show());
    selection.addEventListener("change", () => {
      this.wished = null;
      this.show();
    });
  }

  choiceOfPriority() {
    const values = Array.from({ length: MAX_PRIORITY + 1 }, (_, value) => String(value));
    const onchange = () => this.order("priority", { priority: Number(this.priority.value) });
    return el(
      "select",
      { "aria-label": "Priority", onchange },
      el("option", { value: "", disabled: true }, "–"),
      ...values.map((value) => el("option", { value }, value)),
    );
  }

  get target() {
    return this.feed.data.targets.find((one) => targetName(one.label) === this.selection.target);
  }

  chosen() {
    return this.selection.among(this.feed.data.vehicles);
  }

  /** Return the selected vehicles that are pinned; without any, those that are pinned to the target. */
  unpinnable() {
    const { target } = this.selection;
    const chosen = this.chosen().filter((one) => one.pinned);
    if (chosen.length) return chosen;
    return this.feed.data.vehicles.filter((one) => one.pinned && targetName(one.pinned) === target);
  }

  show() {
    const { target } = this;
    const isReplay = this.feed.data.mission?.kind === "replay";
    this.root.hidden = !this.selection.target || isReplay;
    if (this.root.hidden) return;
    const about = target
      ? `${this.selection.target}, existence ${number(target.existence, 2)}`
      : `${this.selection.target} is no target any more`;
    setText(this.about, about);
    if (document.activeElement !== this.priority) this.priority.value = String(target?.priority ?? "");
    const chosen = this.chosen().map((one) => vehicleName(one.vehicle));
    const pinned = this.unpinnable().map((one) => vehicleName(one.vehicle));
    const mayOrder = this.commands.mayOperate && target !== undefined;
    this.priority.disabled = !mayOrder;
    this.ignoreButton.show(target?.is_ignored ? "Attend" : "Ignore", mayOrder);
    this.pinButton.show(
      chosen.length ? `Pin ${chosen.join(", ")}` : "Pin: select vehicles",
      mayOrder && chosen.length > 0 && !target.is_ignored,
    );
    this.unpinButton.show(`Unpin ${pinned.join(", ")}`, mayOrder);
    this.unpinButton.element.hidden = !pinned.length;
  }

  /** @param {1 | -1} step */
  selectNext(step) {
    const names = this.feed.data.targets.map((one) => targetName(one.label));
    if (!names.length) return;
    const at = names.indexOf(this.selection.target ?? "");
    const first = step > 0 ? 0 : names.length - 1;
    this.selection.setTarget(names[at < 0 ? first : (at + step + names.length) % names.length]);
  }

  /**
   * @param {string} action
   * @param {object} fields
   */
  order(action, fields = {}) {
    if (this.commands.isRefused(action)) return;
    if (this.target) this.orders.give(action, { target: this.selection.target, ...fields });
    else this.orders.say(`${action}: select a target first (click, or T)`, true);
  }

  toggleIgnored() {
    this.order(this.target?.is_ignored ? "attend" : "ignore");
  }

  /** @param {1 | -1} step */
  changePriority(step) {
    const before = this.wished ?? this.target?.priority ?? 0;
    this.wished = Math.min(MAX_PRIORITY, Math.max(0, before + step));
    this.order("priority", { priority: this.wished });
  }

  pin() {
    const vehicles = this.chosen().map((one) => one.vehicle);
    if (vehicles.length || !this.target) this.order("pin", { vehicles });
    else this.orders.say("pin: select vehicles first (click, or their number)", true);
  }

  unpin() {
    const vehicles = this.unpinnable().map((one) => one.vehicle);
    if (this.commands.isRefused("unpin")) return;
    if (vehicles.length) this.orders.give("unpin", { vehicles });
    else this.orders.say("unpin: no selected vehicle is pinned", true);
  }
}

class LabelledButton {
  /**
   * @param {string} key
   * @param {() => void} action
   */
  constructor(key, action) {
    this.label = el("span");
    this.element = el("button", { onclick: action }, this.label, el("kbd", {}, key));
  }

  /**
   * @param {string} text
   * @param {boolean} isEnabled
   */
  show(text, isEnabled) {
    setText(this.label, text);
    this.element.disabled = !isEnabled;
  }
}
