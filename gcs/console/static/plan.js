// Proposed plan: why, who changes, and by how much. Only routes that are on the screen can be confirmed.

import { el, Rows, setClass, setText } from "./dom.js";
import { duration, metres } from "./format.js";

const MAX_NAMED = 6;

function named(routes) {
  if (!routes.length) return "none";
  return routes.length > MAX_NAMED ? `${routes.length} vehicles` : routes.map((route) => route.name).join(", ");
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
    const heads = [["", "left"], ["vehicle", "left"], ["target", "left"], ["length", ""], ["was", "c-was"], ["arrives", ""], ["separation", ""], ["clearance", ""]];
    this.body = el("tbody");
    const head = el("tr", {}, ...heads.map(([text, align]) => el("th", { class: align, scope: "col" }, text)));
    this.all = el("button", { class: "main", onclick: () => this.confirm() });
    this.some = el("button", { onclick: () => this.confirm(true) });
    this.no = el("button", { onclick: () => this.reject() });
    this.root.append(
      this.title, this.why, el("table", {}, el("thead", {}, head), this.body),
      el("div", { class: "actions" }, this.all, this.some, this.no),
    );
    this.rows = new Rows(
      this.body,
      (route) => {
        const box = el("input", {
          type: "checkbox", "aria-label": `vehicle ${route.name}`,
          onchange: () => { this.unchecked[box.checked ? "delete" : "add"](route.id); this.show(); },
        });
        const cells = heads.map(([, align]) => el("td", { class: align }));
        cells[0].append(box);
        return { element: el("tr", {}, ...cells), cells, box };
      },
      (row, route) => {
        row.box.checked = !this.unchecked.has(route.id);
        const texts = [
          route.name, route.target + (route.short ? " (stops short)" : ""), metres(route.length_m), metres(route.shown_length_m),
          duration(route.arrival_s), route.separation_m === null ? "alone" : metres(route.separation_m), metres(route.clearance_m),
        ];
        texts.forEach((text, index) => setText(row.cells[index + 1], text));
        setClass(row.cells[2], route.short ? "left fair" : "left");
      },
    );
  }

  show() {
    const { proposal, mission } = this.feed.data;
    this.root.hidden = !proposal;
    if (!proposal) return;
    if (proposal.id !== this.shownId) {
      this.shownId = proposal.id;
      this.unchecked.clear();
    }
    setText(this.title, `Plan ${proposal.id} waits to be confirmed, for ${duration(proposal.age_s)}`);
    setText(this.why, proposal.reason);
    this.rows.show(proposal.routes, (route) => route.id);
    const chosen = this.chosen();
    setText(this.all, `Confirm plan ${proposal.id} for ${named(proposal.routes)}`);
    setText(this.some, `Confirm for ${named(chosen)} only`);
    setText(this.no, `Reject plan ${proposal.id}`);
    this.some.hidden = chosen.length === proposal.routes.length;
    this.some.disabled = !chosen.length || !this.commands.mayOperate;
    this.all.disabled = this.no.disabled = !this.commands.mayOperate || mission.kind !== "live";
  }

  chosen() {
    return this.feed.data.proposal.routes.filter((route) => !this.unchecked.has(route.id));
  }

  confirm(someOnly = false) {
    const { proposal } = this.feed.data;
    if (!proposal || !this.commands.mayOperate) return;
    const routes = someOnly ? this.chosen() : proposal.routes;
    this.orders.give("confirm", { plan_id: this.shownId, vehicles: routes.map((route) => route.id) });
  }

  reject() {
    if (this.feed.data.proposal && this.commands.mayOperate) this.orders.give("reject", { plan_id: this.shownId });
  }
}
