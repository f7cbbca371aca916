// Rate of frames of one vehicle, over a replay's time as well as in real time.

/**
 * @import { AgentRecord, LinkDetail, VehicleDetail } from "../page_types.d.ts"
 *
 * @typedef {Pick<VehicleDetail, "t_s"> & { agent: Pick<AgentRecord, "vehicle">, link: Pick<LinkDetail, "frames"> }} Counted
 */

const PERIOD_S = 2;

export class FrameRate {
  constructor() {
    /**
     * Null until it is known.
     *
     * @type {number | null}
     */
    this.perSecond = null;
    /** @type {Counted | null} */
    this.before = null;
  }

  /**
   * Count the frames since a record that is old enough. Another vehicle, or an earlier time, begins anew.
   *
   * @param {Counted | null} record
   */
  add(record) {
    const { before } = this;
    const isSame =
      record !== null && before?.agent.vehicle === record.agent.vehicle && record.t_s >= before.t_s;
    if (!isSame) {
      this.perSecond = null;
      this.before = record;
      return;
    }
    const passed = record.t_s - before.t_s;
    if (passed < PERIOD_S) return;
    this.perSecond = (record.link.frames - before.link.frames) / passed;
    this.before = record;
  }
}
