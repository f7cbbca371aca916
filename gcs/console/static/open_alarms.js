// Open alarms and warnings: each until its condition ends, or until it is acknowledged on this screen.
// A newer one of the same condition replaces the older one.

/** @import { LogEntry } from "../page_types.d.ts" */

const URGENCY = { alarm: 2, warning: 1, info: 0 }; // 0: never open

/**
 * Return a name of an entry that it keeps when a replay goes to another time, which numbers all entries anew.
 *
 * @param {LogEntry} entry
 */
function nameOf({ t_s: at, key }) {
  return `${at} ${key}`;
}

/**
 * Proposed plans have a panel of their own, and a refused order is shown beside its button.
 *
 * @param {LogEntry} entry
 */
function isElsewhere({ kind, level }) {
  return kind === "Proposal" || (kind === "OrderAnswer" && level === "warning");
}

export class OpenAlarms {
  /** @param {Pick<Storage, "getItem" | "setItem">} storage keeps what was acknowledged */
  constructor(storage) {
    this.storage = storage;
    this.key = "";
    this.seen = 0;
    /** @type {Set<string>} */
    this.acknowledged = new Set();
    /** @type {Map<string, LogEntry>} */
    this.open = new Map();
  }

  /**
   * Begin a run, or the same one again after a lost connection.
   *
   * @param {string} run
   */
  begin(run) {
    this.key = `acknowledged ${run}`;
    this.seen = 0;
    this.acknowledged = new Set(JSON.parse(this.storage.getItem(this.key) ?? "[]"));
    this.open.clear();
  }

  /**
   * Open the new ones of the log; return the urgency of the worst, 0 for none.
   *
   * @param {LogEntry[]} log
   */
  add(log) {
    let worst = 0;
    for (const entry of log) {
      if (entry.n <= this.seen) continue;
      this.seen = entry.n;
      for (const key of entry.ends) this.open.delete(key);
      const urgency = URGENCY[entry.level];
      if (!urgency || isElsewhere(entry) || this.acknowledged.has(nameOf(entry))) continue;
      this.open.set(entry.key, entry);
      worst = Math.max(worst, urgency);
    }
    return worst;
  }

  /** Return the open ones, the worst and newest first. */
  sorted() {
    return [...this.open.values()].sort((a, b) => URGENCY[b.level] - URGENCY[a.level] || b.n - a.n);
  }

  /** @param {LogEntry[]} entries */
  acknowledge(entries) {
    for (const entry of entries) {
      this.acknowledged.add(nameOf(entry));
      if (this.open.get(entry.key)?.n === entry.n) this.open.delete(entry.key);
    }
    if (this.key) this.storage.setItem(this.key, JSON.stringify([...this.acknowledged]));
  }
}
