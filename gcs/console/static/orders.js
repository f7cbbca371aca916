// Orders: sent by POST, answered by the vehicles. The last one is shown until the next.

import { setClass, setText } from "./dom.js";

const TIMEOUT_MS = 3000;
const BAD = new Set(["refused", "failed"]);

export class Orders {
  constructor(feed) {
    this.feed = feed;
    this.result = null;
    this.lastId = null;
    feed.on(["answers"], () => this.show());
  }

  showIn(element) {
    this.result = element;
  }

  say(text, isBad = false) {
    if (!this.result) return;
    setText(this.result, text);
    this.result.title = text;
    setClass(this.result, `result${isBad ? " bad" : ""}`);
  }

  async give(action, fields = {}) {
    this.lastId = null;
    this.say(`${action}: sent`);
    let reply;
    try {
      reply = await fetch("/api/orders", {
        method: "POST",
        headers: { "content-type": "application/json" },
        body: JSON.stringify({ action, ...fields }),
        signal: AbortSignal.timeout(TIMEOUT_MS),
      });
    } catch {
      this.say(`${action}: no connection, perhaps NOT sent`, true);
      return;
    }
    const content = await reply.json();
    if (content.order_id) {
      this.lastId = content.order_id;
      this.show();
    } else {
      this.say(`${action}: ${content.error}`, true);
    }
  }

  show() {
    const answers = this.feed.data.answers.filter((one) => one.order_id === this.lastId);
    if (!answers.length) return;
    const own = answers.filter((one) => one.vehicle !== null || BAD.has(one.state) || answers.length === 1);
    const texts = own.map(
      (one) => `${one.vehicle === null ? "" : `${one.vehicle} `}${one.state}: ${one.detail}`,
    );
    const waiting = answers.at(-1).waiting;
    if (waiting.length) texts.push(`waiting for ${waiting.join(", ")}`);
    this.say(
      `${answers[0].action}: ${texts.join("; ")}`,
      answers.some((one) => BAD.has(one.state)),
    );
  }
}
