// Selected vehicles, and the selected target.

/** @import { AgentRecord } from "../page_types.d.ts" */

export class Selection extends EventTarget {
  constructor() {
    super();
    /** @type {Set<number>} */
    this.ids = new Set();
    /** @type {string | null} */
    this.target = null;
  }

  /** @param {number} id */
  has(id) {
    return this.ids.has(id);
  }

  /** @param {Iterable<number>} ids */
  set(ids) {
    this.ids = new Set(ids);
    this.dispatchEvent(new Event("change"));
  }

  /** @param {string | null} name */
  setTarget(name) {
    this.target = name;
    this.dispatchEvent(new Event("change"));
  }

  /** @param {string} name */
  toggleTarget(name) {
    this.setTarget(this.target === name ? null : name);
  }

  clear() {
    this.target = null;
    this.set([]);
  }

  /**
   * Select a vehicle, or no longer. A modifier key keeps the others.
   *
   * @param {number} id
   * @param {{ shiftKey: boolean, ctrlKey: boolean, metaKey: boolean }} event
   */
  toggle(id, { shiftKey, ctrlKey, metaKey }) {
    const keepsOthers = shiftKey || ctrlKey || metaKey;
    const others = keepsOthers ? [...this.ids].filter((one) => one !== id) : [];
    this.set(this.ids.has(id) && (keepsOthers || this.ids.size === 1) ? others : [...others, id]);
  }

  /**
   * Return the selected ones of vehicles, in the order of their numbers.
   *
   * @param {AgentRecord[]} vehicles
   */
  among(vehicles) {
    return vehicles.filter((one) => this.ids.has(one.vehicle)).sort((a, b) => a.vehicle - b.vehicle);
  }
}
