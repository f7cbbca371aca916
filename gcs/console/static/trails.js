// Trails: where each vehicle was. A gap is null: where it flew then is not known.

/** @import { AgentRecord, Trail } from "../page_types.d.ts" */

import { distance } from "./geometry.js";

const MAX_POINTS = 1500;
const STEP_M = 5;

export class Trails {
  constructor() {
    /** @type {Map<number, Trail>} */
    this.trails = new Map();
  }

  all() {
    return this.trails.values();
  }

  /**
   * Begin with what was before this page.
   *
   * @param {Record<string, Trail>} trails
   */
  begin(trails) {
    this.trails = new Map(Object.entries(trails).map(([id, trail]) => [Number(id), [...trail]]));
  }

  /** @param {AgentRecord[]} vehicles */
  add(vehicles) {
    for (const { vehicle: id, position_m: at, alt_msl_m: alt, is_late: isLate, status } of vehicles) {
      const trail = this.trails.get(id) ?? [];
      const last = trail.at(-1);
      if (isLate && last) trail.push(null);
      if (!at || isLate || status === "lost") continue;
      if (!last || distance([last[0], last[1]], at) > STEP_M) trail.push([at[0], at[1], alt ?? 0]);
      if (trail.length > MAX_POINTS) trail.shift();
      this.trails.set(id, trail);
    }
  }
}
