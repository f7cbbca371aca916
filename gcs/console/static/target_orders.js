// Orders about the selected target: ignore or attend, priority, pin and unpin vehicles.

import { el, setText } from "./dom.js";
import { number } from "./format.js";

const MAX_PRIORITY = 9;

export class TargetOrders {
  constructor(root, feed, selection, orders, commands) {
    this.root = root;
    this.feed = feed;
    this.selection = selection;
    this.orders = orders;
    this.commands = commands;
    this.wished = null; // priority just ordered, until the feed shows it
    this.build();
    feed.on(["targets", "vehicles", "mission"], () => this.show());
    feed.addEventListener("lost", () => this.show());
    selection.addEventListener("change", () => {
      this.wished = null;
      this.show();
    });
  }

  build() {
    const button = (key, action) => {
      const label = el("span");
      return { label, element: el("button", { onclick: action }, label, el("kbd", {}, key)) };
    };
    this.about = el("strong");
    this.ignore = button("I", () => this.toggleIgnored());
    this.priority = el(
      "select",
      {
        "aria-label": "Priority",
        onchange: () => this.order("priority", { priority: Number(this.priority.value) }),
      },
      el("option", { value: "", disabled: true }, "–"),
      ...Array.from({ length: MAX_PRIORITY + 1 }, (_, value) =>
        el("option", { value: String(value) }, String(value)),
      ),
    );
    this.pinned = button("P", () => this.pin());
    this.unpinned = button("U", () => this.unpin());
    this.root.append(
      this.about,
      this.ignore.element,
      el("label", {}, "Priority", this.priority),
      this.pinned.element,
      this.unpinned.element,
      el("span", { class: "space" }),
      el("button", { title: "Select no target", onclick: () => this.selection.setTarget(null) }, "Close"),
    );
  }

  get target() {
    return (this.feed.data.targets ?? []).find((one) => one.name === this.selection.target);
  }

  // Selected vehicles; without any, those that are pinned to the target.
  unpinnable() {
    const vehicles = this.feed.data.vehicles ?? [];
    const chosen = this.selection.among(vehicles).filter((one) => one.pinned);
    return chosen.length
      ? chosen
      : vehicles.filter((one) => one.pinned && one.pinned === this.selection.target);
  }

  show() {
    const { target } = this;
    const isReplay = this.feed.data.mission?.kind === "replay";
    this.root.hidden = !this.selection.target || isReplay;
    if (this.root.hidden) return;
    const mayOrder = this.commands.mayOperate && Boolean(target);
    setText(
      this.about,
      target
        ? `${target.name}, existence ${number(target.existence, 2)}`
        : `${this.selection.target} is no target any more`,
    );
    setText(this.ignore.label, target?.ignored ? "Attend" : "Ignore");
    if (document.activeElement !== this.priority) this.priority.value = String(target?.priority ?? "");
    const chosen = this.selection.among(this.feed.data.vehicles ?? []).map((one) => one.name);
    setText(this.pinned.label, chosen.length ? `Pin ${chosen.join(", ")}` : "Pin: select vehicles");
    const pinned = this.unpinnable().map((one) => one.name);
    setText(this.unpinned.label, `Unpin ${pinned.join(", ")}`);
    this.unpinned.element.hidden = !pinned.length;
    for (const one of [this.ignore.element, this.priority, this.unpinned.element]) one.disabled = !mayOrder;
    this.pinned.element.disabled = !mayOrder || !chosen.length || target.ignored;
  }

  selectNext(step) {
    const names = (this.feed.data.targets ?? []).map((one) => one.name);
    if (!names.length) return;
    const at = names.indexOf(this.selection.target);
    this.selection.setTarget(
      names[at < 0 ? (step > 0 ? 0 : names.length - 1) : (at + step + names.length) % names.length],
    );
  }

  order(action, fields = {}) {
    if (this.commands.isRefused(action)) return;
    if (!this.target) this.orders.say(`${action}: select a target first (click, or T)`, true);
    else this.orders.give(action, { target: this.target.name, ...fields });
  }

  toggleIgnored() {
    this.order(this.target?.ignored ? "attend" : "ignore");
  }

  changePriority(step) {
    const priority = Math.min(MAX_PRIORITY, Math.max(0, (this.wished ?? this.target?.priority ?? 0) + step));
    this.wished = priority;
    this.order("priority", { priority });
  }

  pin() {
    const vehicles = this.selection.among(this.feed.data.vehicles ?? []).map((one) => one.id);
    if (vehicles.length || !this.target) this.order("pin", { vehicles });
    else this.orders.say("pin: select vehicles first (click, or their number)", true);
  }

  unpin() {
    const vehicles = this.unpinnable().map((one) => one.id);
    if (this.commands.isRefused("unpin")) return;
    if (vehicles.length) this.orders.give("unpin", { vehicles });
    else this.orders.say("unpin: no selected vehicle is pinned", true);
  }
}
