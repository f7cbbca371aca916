// Panels below the vehicles: which one is open. One at a time, so that none covers another.

import { el, part, setText } from "./dom.js";

/** @typedef {"targets" | "detail" | "profile" | "alarms" | "charts"} PanelName */

/** @type {Record<PanelName, { title: string, id: string }>} */
const PANELS = {
  targets: { title: "Targets", id: "targets" },
  detail: { title: "Details", id: "detail" },
  profile: { title: "Profile", id: "profile" },
  alarms: { title: "Alarms", id: "alarm-list" },
  charts: { title: "Charts", id: "charts" },
};
const NAMES = /** @type {PanelName[]} */ (Object.keys(PANELS));

/** Dispatches "change" when another panel is shown. */
export class Panels extends EventTarget {
  /** @param {HTMLElement} root */
  constructor(root) {
    super();
    this.root = root;
    /** @type {PanelName} */
    this.current = "targets";
    this.tabs = ofEach((name) => this.tab(name));
    this.roots = ofEach((name) => part(PANELS[name].id));
    for (const one of Object.values(this.roots)) one.setAttribute("role", "tabpanel");
    const tabs = Object.values(this.tabs);
    root.prepend(el("div", { class: "tabs", role: "tablist", "aria-label": "Panels" }, ...tabs));
    this.show("targets");
  }

  /** @param {PanelName} name */
  tab(name) {
    const { title, id } = PANELS[name];
    const onclick = () => this.show(name);
    return el("button", { id: `tab-${name}`, role: "tab", "aria-controls": id, onclick }, title);
  }

  /** @param {PanelName} name */
  show(name) {
    this.current = name;
    this.root.dataset.panel = name;
    for (const one of NAMES) {
      this.roots[one].hidden = one !== name;
      this.tabs[one].setAttribute("aria-selected", String(one === name));
    }
    this.dispatchEvent(new Event("change"));
  }

  /** @param {PanelName} name */
  toggle(name) {
    this.show(this.current === name ? "targets" : name);
  }

  /**
   * Bring the details of what is selected to the front, but not before a panel that was opened by hand.
   *
   * @param {boolean} isSelected
   */
  follow(isSelected) {
    if (isSelected && this.current === "targets") this.show("detail");
    else if (!isSelected && this.current === "detail") this.show("targets");
  }

  /**
   * Write a number on a tab; nothing for 0.
   *
   * @param {PanelName} name
   * @param {number} count
   */
  count(name, count) {
    const { title } = PANELS[name];
    setText(this.tabs[name], count ? `${title} (${count})` : title);
  }
}

/**
 * @template Made
 * @param {(name: PanelName) => Made} make
 */
function ofEach(make) {
  const made = Object.fromEntries(NAMES.map((name) => [name, make(name)]));
  return /** @type {Record<PanelName, Made>} */ (made);
}
