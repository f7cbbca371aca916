// Commands for the selected vehicles. Each button says for which vehicles it is.

import { ask } from "./dialogs.js";
import { el, setText } from "./dom.js";

const RISKS = {
  arm: "Propellers may turn.",
  disarm: "A vehicle that may be in the air is refused.",
  ready: "Somebody has looked at them: they can fly again.",
  return: "They fly to their launch points and take no tasks until resumed.",
};
const BUTTONS = [
  ["hold", "Hold", "space", "main"],
  ["resume", "Resume", "R", ""],
  ["return", "Return", "B", ""],
  ["arm", "Arm", "A", "danger"],
  ["disarm", "Disarm", "D", "danger"],
  ["ready", "Ready", "", "danger"],
];
const MAX_NAMED = 5;

export class Commands {
  constructor(root, feed, selection, orders, drawZone) {
    this.feed = feed;
    this.selection = selection;
    this.orders = orders;
    this.labels = {};
    this.buttons = [];
    for (const [action, title, key, style] of BUTTONS) {
      const label = el("span", {}, title);
      this.labels[action] = [label, title];
      this.add(
        root,
        el(
          "button",
          { class: style, "data-action": action, onclick: () => this.give(action) },
          label,
          el("kbd", {}, key),
        ),
      );
    }
    this.add(
      root,
      el("button", { "data-action": "zone", onclick: drawZone }, "No-fly zone", el("kbd", {}, "N")),
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
    this.add(root, this.goOn);
    const result = el("span", { class: "result", role: "status" });
    root.append(result);
    orders.showIn(result);
    this.add(
      root,
      el(
        "button",
        { class: "stop", "data-action": "hold-all", onclick: () => this.holdAll() },
        "Hold all",
        el("kbd", {}, "shift+space"),
      ),
    );
    feed.on(["mission", "vehicles", "head"], () => this.show());
    feed.addEventListener("lost", () => this.show());
    selection.addEventListener("change", () => this.show());
    this.root = root;
    this.show();
  }

  add(root, button) {
    this.buttons.push(button);
    root.append(button);
  }

  get mayOperate() {
    return this.feed.connected && this.feed.role === "operate" && this.feed.data.mission?.kind === "live";
  }

  chosen() {
    return this.selection.among(this.feed.data.vehicles ?? []);
  }

  show() {
    const chosen = this.chosen();
    const names = chosen.map((one) => one.name);
    const text =
      names.length > MAX_NAMED
        ? `${names.slice(0, MAX_NAMED).join(", ")} +${names.length - MAX_NAMED}`
        : names.join(", ");
    for (const [label, title] of Object.values(this.labels))
      setText(label, text ? `${title} ${text}` : title);
    for (const button of this.buttons) {
      const needsVehicles = button.dataset.action in this.labels;
      button.disabled = !this.mayOperate || (needsVehicles && !chosen.length);
    }
    this.goOn.hidden = !this.feed.data.head?.ended;
    this.root.hidden = this.feed.data.mission?.kind === "replay";
  }

  async give(action) {
    const chosen = this.chosen();
    if (this.isRefused(action)) return;
    if (!chosen.length) {
      this.orders.say(`${action}: select vehicles first (click, or their number)`, true);
      return;
    }
    const names = chosen.map((one) => one.name).join(", ");
    const title = this.labels[action][1];
    const who = `${chosen.length > 1 ? "vehicles" : "vehicle"} ${names}`;
    if (action in RISKS && !(await ask(`${title} ${who}?`, RISKS[action], `${title} ${names}`))) return;
    this.orders.give(action, { vehicles: chosen.map((one) => one.id) });
  }

  holdAll() {
    if (!this.isRefused("hold all")) this.orders.give("hold", { vehicles: "all" });
  }

  continueMission() {
    if (!this.isRefused("continue")) this.orders.give("continue", { vehicles: "all" });
  }

  // Says why an order is not sent: a key pressed in vain must not pass unnoticed.
  isRefused(what) {
    if (this.mayOperate) return false;
    const why = !this.feed.connected
      ? "no connection"
      : this.feed.role === "view"
        ? "this token may view only"
        : "this is a replay";
    this.orders.say(`${what}: ${why}, NOT sent`, true);
    return true;
  }
}
