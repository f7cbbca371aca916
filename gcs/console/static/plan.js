// Proposed plan: why, who changes, and by how much. Only checked routes are confirmed, all at first.
// After a new number the buttons wait, so that a press does not confirm a plan that came just before it.

import { el, Rows, setClass, setText } from "./dom.js";
import { duration, metres } from "./format.js";

const MAX_NAMED = 6;
const READING_MS = 1000;

function named(routes) {
  if (!routes.length) return "none";
  return routes.length > MAX_NAMED
    ? `${routes.length} vehicles`
    : routes.map((route) => route.name).join(", ");
}

export class Plan {
  constructor(root, feed, orders, commands) {
    this.root = root;
    this.feed = feed;
    this.orders = orders;
    this.commands = commands;
    this.shownId = null;
    this.unchecked = new Set();
    this.build();
    feed.on(["proposal", "head"], () => this.show());
  }

  build() {
    this.title = el("h2");
    this.why = el("div", { class: "why" });
    const heads = [
      ["", "left"],
      ["vehicle", "left"],
      ["target", "left"],
      ["length", ""],
      ["was", "c-was"],
      ["arrives", ""],
      ["separation", ""],
      ["clearance", ""],
    ];
    this.body = el("tbody");
    const head = el(
      "tr",
      {},
      ...heads.map(([text, align]) => el("th", { class: align, scope: "col" }, text)),
    );
    this.yes = el("button", { class: "main", onclick: () => this.confirm() });
    this.no = el("button", { onclick: () => this.reject() });
    this.root.append(
      this.title,
      this.why,
      el("table", {}, el("thead", {}, head), this.body),
      el("div", { class: "actions" }, this.yes, this.no),
    );
    this.rows = new Rows(
      this.body,
      (route) => {
        const box = el("input", {
          type: "checkbox",
          "aria-label": `vehicle ${route.name}`,
          onchange: () => {
            this.unchecked[box.checked ? "delete" : "add"](route.id);
            this.show();
          },
        });
        const cells = heads.map(([, align]) => el("td", { class: align }));
        cells[0].append(box);
        return { element: el("tr", {}, ...cells), cells, box };
      },
      (row, route) => {
        row.box.checked = !this.unchecked.has(route.id);
        const texts = [
          route.name,
          route.target + (route.short ? " (stops short)" : ""),
          metres(route.length_m),
          metres(route.shown_length_m),
          duration(route.arrival_s),
          route.separation_m === null ? "alone" : metres(route.separation_m),
          metres(route.clearance_m),
        ];
        texts.forEach((text, index) => setText(row.cells[index + 1], text));
        setClass(row.cells[2], route.short ? "left fair" : "left");
      },
    );
  }

  show() {
    const { proposal } = this.feed.data;
    this.root.hidden = !proposal;
    if (!proposal) return;
    if (proposal.id !== this.shownId) {
      this.shownId = proposal.id;
      this.shownAt = performance.now();
      setTimeout(() => this.show(), READING_MS);
      this.unchecked.clear();
    }
    setText(this.title, `Plan ${proposal.id} waits to be confirmed, for ${duration(proposal.age_s)}`);
    setText(this.why, proposal.reason);
    this.rows.show(proposal.routes, (route) => route.id);
    const chosen = this.chosen();
    setText(this.yes, `Confirm plan ${proposal.id} for ${named(chosen)}`);
    setText(this.no, `Reject plan ${proposal.id}`);
    const isLocked = !this.commands.mayOperate || performance.now() - this.shownAt < READING_MS;
    this.yes.disabled = !chosen.length || isLocked;
    this.no.disabled = isLocked;
  }

  // Keys move the focus to a button; Enter presses it.
  focus(name) {
    if (!this.root.hidden) this[name].focus();
  }

  chosen() {
    return this.feed.data.proposal.routes.filter((route) => !this.unchecked.has(route.id));
  }

  confirm() {
    this.orders.give("confirm", { plan_id: this.shownId, vehicles: this.chosen().map((route) => route.id) });
  }

  reject() {
    this.orders.give("reject", { plan_id: this.shownId });
  }
}
