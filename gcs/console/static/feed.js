// Feed: a WebSocket that brings a snapshot, then updates. It connects again after a loss.

const MIN_RETRY_MS = 500;
const MAX_RETRY_MS = 5000;
const MAX_LOG = 1000;

export class Feed extends EventTarget {
  constructor() {
    super();
    this.data = { log: [], answers: [] };
    this.role = "view";
    this.connected = false;
    this.heardAt = 0;
    this.retryMs = MIN_RETRY_MS;
  }

  connect() {
    const url = new URL("feed", document.baseURI); // each page has its own, see compare.js
    url.protocol = url.protocol.replace("http", "ws");
    const socket = new WebSocket(url);
    const decoder = new TextDecoder();
    socket.binaryType = "arraybuffer";
    socket.onmessage = (event) => this.receive(JSON.parse(decoder.decode(event.data)));
    socket.onclose = () => this.lose();
  }

  receive(message) {
    this.heardAt = Date.now();
    const { type, log = [], answers = [], ...sections } = message;
    if (type === "role") {
      this.role = message.role;
      return;
    }
    const fresh = type === "snapshot";
    if (fresh) {
      this.data = { log, answers };
      this.connected = true;
      this.retryMs = MIN_RETRY_MS;
    } else {
      this.data.log = [...this.data.log, ...log].slice(-MAX_LOG);
      this.data.answers = [...this.data.answers, ...answers].slice(-MAX_LOG);
    }
    Object.assign(this.data, sections);
    const names = new Set(Object.keys(sections));
    if (fresh || log.length) names.add("log");
    if (fresh || answers.length) names.add("answers");
    this.dispatchEvent(new CustomEvent("data", { detail: { names, fresh } }));
  }

  lose() {
    this.connected = false;
    this.dispatchEvent(new Event("lost"));
    setTimeout(() => this.connect(), this.retryMs);
    this.retryMs = Math.min(MAX_RETRY_MS, this.retryMs * 1.5);
  }

  // Calls back when one of the named sections has changed.
  on(names, callback) {
    this.addEventListener("data", (event) => {
      if (names.some((name) => event.detail.names.has(name))) callback(this.data, event.detail.fresh);
    });
  }
}
