// Feed: a WebSocket that brings a snapshot, then updates. It connects again after a loss.

const MIN_RETRY_MS = 500;
const MAX_RETRY_MS = 5000;
const MAX_LOG = 1000;
const USE_MS = 5000;

export class Feed extends EventTarget {
  constructor() {
    super();
    this.data = { log: [], answers: [] };
    this.role = "view";
    this.connected = false;
    this.heardAt = 0;
    this.retryMs = MIN_RETRY_MS;
    this.toldAt = 0;
    for (const kind of ["pointerdown", "keydown"])
      document.addEventListener(kind, () => this.tellUse(), { capture: true });
  }

  connect() {
    const url = new URL("feed", document.baseURI); // each page has its own, see compare.js
    url.protocol = url.protocol.replace("http", "ws");
    const socket = new WebSocket(url);
    const decoder = new TextDecoder();
    socket.binaryType = "arraybuffer";
    this.socket = socket;
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

  // When too many pages are open, those that nobody uses are closed first.
  tellUse() {
    if (this.socket?.readyState !== WebSocket.OPEN || Date.now() - this.toldAt < USE_MS) return;
    this.toldAt = Date.now();
    this.socket.send("used");
  }

  // Calls back when one of the named sections has changed.
  on(names, callback) {
    this.addEventListener("data", (event) => {
      if (names.some((name) => event.detail.names.has(name))) callback(this.data, event.detail.fresh);
    });
  }
}
