// Feed: a WebSocket that brings a snapshot, then updates. It connects again after a loss.

/**
 * @import { FeedMessage, Role, Sections, SnapshotMessage, UpdateMessage } from "../page_types.d.ts"
 *
 * @typedef {"vehicles" | "targets" | "zones" | "routes" | "log" | "answers" | "trails"} ListName
 * @typedef {Sections & Required<Pick<Sections, ListName>>} FeedData lists are empty until they come
 * @typedef {Set<keyof Sections>} Names
 */

const MIN_RETRY_MS = 500;
const MAX_RETRY_MS = 5000;
const MAX_LOG = 1000;
const USE_MS = 5000;

/** @returns {FeedData} */
const withoutData = () => ({
  vehicles: [],
  targets: [],
  zones: [],
  routes: [],
  log: [],
  answers: [],
  trails: {},
});

export class Feed extends EventTarget {
  constructor() {
    super();
    this.data = withoutData();
    /** @type {Role} */
    this.role = "view";
    this.connected = false;
    this.heardAt = 0;
    this.retryMs = MIN_RETRY_MS;
    this.toldAt = 0;
    /** @type {WebSocket | null} */
    this.socket = null;
    for (const kind of ["pointerdown", "keydown"])
      document.addEventListener(kind, () => this.tellUse(), { capture: true });
  }

  connect() {
    const url = new URL("feed", document.baseURI); // each page has its own, see compare.js
    url.protocol = url.protocol.replace("http", "ws");
    const socket = new WebSocket(url);
    const decoder = new TextDecoder();
    socket.binaryType = "arraybuffer";
    socket.onmessage = (event) => this.receive(JSON.parse(decoder.decode(event.data)));
    socket.onclose = () => this.lose();
    this.socket = socket;
  }

  /** @param {FeedMessage} message */
  receive(message) {
    this.heardAt = Date.now();
    if (message.type === "role") this.role = message.role;
    else this.take(message);
  }

  /** @param {SnapshotMessage | UpdateMessage} message */
  take({ type, log = [], answers = [], ...sections }) {
    const isFresh = type === "snapshot";
    if (isFresh) {
      this.data = withoutData();
      this.connected = true;
      this.retryMs = MIN_RETRY_MS;
    }
    this.data.log = [...this.data.log, ...log].slice(-MAX_LOG);
    this.data.answers = [...this.data.answers, ...answers].slice(-MAX_LOG);
    Object.assign(this.data, sections);
    const names = /** @type {Names} */ (new Set(Object.keys(sections)));
    if (isFresh || log.length) names.add("log");
    if (isFresh || answers.length) names.add("answers");
    this.dispatchEvent(new CustomEvent("data", { detail: { names, isFresh } }));
  }

  lose() {
    this.connected = false;
    this.dispatchEvent(new Event("lost"));
    setTimeout(() => this.connect(), this.retryMs);
    this.retryMs = Math.min(MAX_RETRY_MS, this.retryMs * 1.5);
  }

  /** Tell the server that somebody uses this page: of too many pages, unused ones are closed first. */
  tellUse() {
    if (this.socket?.readyState !== WebSocket.OPEN || Date.now() - this.toldAt < USE_MS) return;
    this.toldAt = Date.now();
    this.socket.send("used");
  }

  /**
   * Call back with the names of the sections that have changed, and whether all are new.
   *
   * @param {(names: Names, isFresh: boolean) => void} callback
   */
  onData(callback) {
    this.addEventListener("data", (event) => {
      /** @type {{ names: Names, isFresh: boolean }} */
      const { names, isFresh } = /** @type {CustomEvent} */ (event).detail;
      callback(names, isFresh);
    });
  }

  /**
   * Call back with a section when it has changed.
   *
   * @template {keyof Sections} Name
   * @param {Name} name
   * @param {(section: Required<Sections>[Name], isFresh: boolean) => void} callback
   */
  on(name, callback) {
    this.onData((names, isFresh) => {
      if (names.has(name)) callback(/** @type {Required<Sections>[Name]} */ (this.data[name]), isFresh);
    });
  }

  /**
   * Call back when one of some sections has changed.
   *
   * @param {(keyof Sections)[]} some
   * @param {() => void} callback
   */
  onAny(some, callback) {
    this.onData((names) => {
      if (some.some((name) => names.has(name))) callback();
    });
  }
}
