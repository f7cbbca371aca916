// Panels below the vehicles: one at a time, so that none covers another.

import { el, setText } from "./dom.js";

const TITLES = { targets: "Targets", detail: "Details", alarms: "Alarms", charts: "Charts" };
const ROOTS = { targets: "targets", detail: "detail", alarms: "alarm-list", charts: "charts" };

export class Panels extends EventTarget {
  constructor(root) {
    super();
    this.root = root;
    this.tabs = {};
    this.roots = {};
    for (const [name, title] of Object.entries(TITLES)) {
      this.roots[name] = document.getElementById(ROOTS[name]);
      this.roots[name].setAttribute("role", "tabpanel");
      this.tabs[name] = el(
        "button",
        { id: `tab-${name}`, role: "tab", "aria-controls": ROOTS[name], onclick: () => this.show(name) },
        title,
      );
    }
    root.prepend(
      el("div", { class: "tabs", role: "tablist", "aria-label": "Panels" }, ...Object.values(this.tabs)),
    );
    this.show("targets");
  }

  show(name) {
    this.current = name;
    this.root.dataset.panel = name;
    for (const [one, root] of Object.entries(this.roots)) {
      root.hidden = one !== name;
      this.tabs[one].setAttribute("aria-selected", String(one === name));
    }
    this.dispatchEvent(new Event("change"));
  }

  toggle(name) {
    this.show(this.current === name ? "targets" : name);
  }

  // What is selected comes to the front, but not before what was opened by hand.
  follow(isSelected) {
    if (isSelected && this.current === "targets") this.show("detail");
    else if (!isSelected && this.current === "detail") this.show("targets");
  }

  count(name, number) {
    setText(this.tabs[name], number ? `${TITLES[name]} (${number})` : TITLES[name]);
  }
}
