// Sending of orders by POST. The answer of the vehicles is shown until the next order.

/**
 * @import { OrderReply } from "../page_types.d.ts"
 * @import { Feed } from "./feed.js"
 */

import { el, setClass, setText } from "./dom.js";
import { vehicleName } from "./format.js";
import { errorOf, post } from "./requests.js";

const TIMEOUT_MS = 3000;
const BAD = new Set(["refused", "failed"]);

export class Orders {
  /** @param {Feed} feed */
  constructor(feed) {
    this.feed = feed;
    this.result = el("span", { class: "result", role: "status" });
    /** @type {string | null} */
    this.lastId = null;
    feed.on("answers", () => this.show());
  }

  /**
   * @param {string} text
   * @param {boolean} isBad
   */
  say(text, isBad = false) {
    setText(this.result, text);
    this.result.title = text;
    setClass(this.result, `result${isBad ? " bad" : ""}`);
  }

  /**
   * @param {string} action
   * @param {object} fields
   */
  async give(action, fields = {}) {
    this.lastId = null;
    this.say(`${action}: sent`);
    let reply;
    try {
      reply = await post("/api/orders", { action, ...fields }, AbortSignal.timeout(TIMEOUT_MS));
    } catch {
      this.say(`${action}: no connection, perhaps NOT sent`, true);
      return;
    }
    if (!reply.ok) {
      this.say(`${action}: ${await errorOf(reply)}`, true);
      return;
    }
    /** @type {OrderReply} */
    const { order_id: id } = await reply.json();
    this.lastId = id;
    this.show();
  }

  show() {
    const answers = this.feed.data.answers.filter((one) => one.order_id === this.lastId);
    const last = answers.at(-1);
    if (!last) return;
    const own = answers.filter((one) => one.vehicle !== null || BAD.has(one.state) || answers.length === 1);
    const texts = own.map(
      ({ vehicle, state, detail }) =>
        `${vehicle === null ? "" : `${vehicleName(vehicle)} `}${state}: ${detail}`,
    );
    if (last.waiting.length) texts.push(`waiting for ${last.waiting.map(vehicleName).join(", ")}`);
    const isBad = answers.some((one) => BAD.has(one.state));
    this.say(`${last.action}: ${texts.join("; ")}`, isBad);
  }
}
