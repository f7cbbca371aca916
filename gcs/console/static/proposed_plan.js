// Plan that waits for approval: why, who changes, and by how much. Only checked routes are confirmed.
// After a new number the buttons wait, so that a press does not confirm a plan that came just before it.

/**
 * @import { Proposal, Route } from "../page_types.d.ts"
 * @import { Commands } from "./vehicle_orders.js"
 * @import { Feed } from "./feed.js"
 * @import { Orders } from "./order_sending.js"
 */

import { el, Rows, setClass, setText, tableOf } from "./dom.js";
import { duration, metres, targetName, vehicleName } from "./format.js";

const MAX_NAMED = 6;
const READING_MS = 1000;
const NS_PER_S = 1e9;
/** @type {[string, string][]} */
const HEADS = [
  ["", "left"],
  ["vehicle", "left"],
  ["target", "left"],
  ["length", ""],
  ["was", "c-was"],
  ["arrives", ""],
  ["separation", ""],
  ["clearance", ""],
];

/** @param {Route[]} routes */
function namesOf(routes) {
  if (!routes.length) return "none";
  if (routes.length > MAX_NAMED) return `${routes.length} vehicles`;
  return routes.map((route) => vehicleName(route.vehicle)).join(", ");
}

/**
 * Return the time since a plan was first shown, in seconds.
 *
 * @param {Proposal} proposal
 */
const ageOf = ({ t_ns: now, shown_t_ns: shown }) => (shown ? (now - shown) / NS_PER_S : 0);

export class Plan {
  /**
   * @param {HTMLElement} root
   * @param {Feed} feed
   * @param {Orders} orders
   * @param {Commands} commands
   */
  constructor(root, feed, orders, commands) {
    this.root = root;
    this.feed = feed;
    this.orders = orders;
    this.commands = commands;
    /** @type {number | null} */
    this.shownId = null;
    this.shownAt = 0;
    /** @type {Set<number>} */
    this.unchecked = new Set();
    this.title = el("h2");
    this.why = el("div", { class: "why" });
    this.confirm = el("button", {
      class: "main",
      onclick: () => this.give("confirm", { vehicles: this.chosen().map((route) => route.vehicle) }),
    });
    this.reject = el("button", { onclick: () => this.give("reject") });
    const body = el("tbody");
    /** @type {Rows<Route, number, ReturnType<Plan["makeRow"]>>} */
    this.rows = new Rows(
      body,
      (route) => this.makeRow(route),
      (row, route) => this.updateRow(row, route),
      (route) => route.vehicle,
    );
    const actions = el("div", { class: "actions" }, this.confirm, this.reject);
    root.append(this.title, this.why, tableOf(HEADS, body), actions);
    feed.onAny(["proposal", "head"], () => this.show());
  }

  /** @param {Route} route */
  makeRow(route) {
    const onchange = () => {
      if (box.checked) this.unchecked.delete(route.vehicle);
      else this.unchecked.add(route.vehicle);
      this.show();
    };
    const box = el("input", {
      type: "checkbox",
      "aria-label": `vehicle ${vehicleName(route.vehicle)}`,
      onchange,
    });
    const cells = HEADS.map(([, name]) => el("td", { class: name }));
    cells[0].append(box);
    return { element: el("tr", {}, ...cells), cells, box };
  }

  /**
   * @param {ReturnType<Plan["makeRow"]>} row
   * @param {Route} route
   */
  updateRow({ box, cells }, route) {
    const { vehicle, target } = route;
    const figures = this.feed.data.proposal?.figures.find((one) => one.vehicle === vehicle);
    box.checked = !this.unchecked.has(vehicle);
    const texts = [
      vehicleName(vehicle),
      targetName(target) + (figures?.is_short ? " (stops short)" : ""),
      metres(figures?.length_m ?? route.length_m),
      metres(figures?.shown_length_m),
      duration(figures?.arrival_s),
      figures?.separation_m === null ? "alone" : metres(figures?.separation_m),
      metres(figures?.clearance_m),
    ];
    for (const [index, text] of texts.entries()) setText(cells[index + 1], text);
    setClass(cells[2], figures?.is_short ? "left fair" : "left");
  }

  show() {
    const { proposal } = this.feed.data;
    this.root.hidden = !proposal;
    if (!proposal) return;
    if (proposal.plan_id !== this.shownId) this.begin(proposal);
    setText(this.title, `Plan ${proposal.plan_id} waits to be confirmed, for ${duration(ageOf(proposal))}`);
    setText(this.why, proposal.reason);
    this.rows.show(proposal.routes);
    const chosen = this.chosen();
    setText(this.confirm, `Confirm plan ${proposal.plan_id} for ${namesOf(chosen)}`);
    setText(this.reject, `Reject plan ${proposal.plan_id}`);
    const isNew = performance.now() - this.shownAt < READING_MS;
    const isLocked = !this.commands.mayOperate || isNew;
    this.confirm.disabled = !chosen.length || isLocked;
    this.reject.disabled = isLocked;
  }

  /** @param {Proposal} proposal */
  begin(proposal) {
    this.shownId = proposal.plan_id;
    this.shownAt = performance.now();
    setTimeout(() => this.show(), READING_MS);
    this.unchecked.clear();
  }

  /**
   * Move the focus to a button; Enter presses it.
   *
   * @param {"confirm" | "reject"} name
   */
  focus(name) {
    if (!this.root.hidden) this[name].focus();
  }

  chosen() {
    const routes = this.feed.data.proposal?.routes ?? [];
    return routes.filter((route) => !this.unchecked.has(route.vehicle));
  }

  /**
   * @param {"confirm" | "reject"} action
   * @param {object} fields
   */
  give(action, fields = {}) {
    this.orders.give(action, { plan_id: this.shownId, ...fields });
  }
}
