// Layers of the map: which the user wants to see, and the panel that asks.

import { el, setText } from "./dom.js";

/** @typedef {keyof typeof TITLES} LayerName */

const TITLES = {
  terrain: "Terrain: hill shading, contours",
  tiles: "Map tiles",
  trails: "Trails",
  late: "Late estimates", // with the number of scans
  routes: "Routes",
  ellipses: "Tracked ellipses (1σ, 3σ)",
  detections: "Detections",
  altitudes: "Altitudes",
  labels: "Target labels",
  tentative: "Unconfirmed targets",
  views: "Fields of view",
  fence: "Fence and homes",
};
const HIDDEN = new Set(["views", "tentative"]); // until the user shows them

export class MapLayers extends EventTarget {
  constructor() {
    super();
    const names = /** @type {LayerName[]} */ (Object.keys(TITLES));
    const defaults = Object.fromEntries(names.map((name) => [name, !HIDDEN.has(name)]));
    /** @type {Record<LayerName, boolean>} */
    this.shown = { ...defaults, ...JSON.parse(localStorage.getItem("layers") ?? "{}") };
    const choices = names.map((name) => this.choice(name));
    this.late = choices[names.indexOf("late")];
    this.late.hidden = true;
    this.panel = el("div", { class: "layers", hidden: true }, ...choices);
    // A click leaves the focus where it is: else the next space would tick the layer again, and hold nothing.
    this.panel.addEventListener("mousedown", (event) => event.preventDefault());
  }

  /** @param {number} scans by which late estimates are late; 0: there are none */
  setLag(scans) {
    this.late.hidden = !scans;
    const text = `Estimates ${scans} scan${scans === 1 ? "" : "s"} late (dotted)`;
    if (this.late.lastChild) setText(/** @type {Element} */ (this.late.lastChild), text);
  }

  /** @param {LayerName} name */
  choice(name) {
    const box = el("input", { type: "checkbox", onchange: () => this.set(name, box.checked) });
    box.checked = this.shown[name];
    return el("label", {}, box, el("span", {}, TITLES[name]));
  }

  /**
   * @param {LayerName} name
   * @param {boolean} isShown
   */
  set(name, isShown) {
    this.shown[name] = isShown;
    localStorage.setItem("layers", JSON.stringify(this.shown));
    this.dispatchEvent(new Event("change"));
  }

  /**
   * Open or close the panel; return whether it is open.
   *
   * @param {boolean} takesFocus
   */
  toggle(takesFocus) {
    this.panel.hidden = !this.panel.hidden;
    if (!this.panel.hidden && takesFocus) this.panel.querySelector("input")?.focus();
    return !this.panel.hidden;
  }
}
