// An alarm would not be seen, or come back after it was acknowledged.

/** @import { LogEntry } from "../../../gcs/console/page_types.d.ts" */

import assert from "node:assert/strict";
import { test } from "node:test";
import { OpenAlarms } from "../../../gcs/console/static/open_alarms.js";

/**
 * @param {number} n
 * @param {string} text
 * @param {Partial<LogEntry>} more
 * @returns {LogEntry}
 */
function entry(n, text, more = {}) {
  const notice = { code: "agent-lost", key: text, ends: [] };
  return { n, t_s: n, level: "alarm", text, kind: "Notice", vehicle: null, ...notice, ...more };
}

function storage() {
  /** @type {Map<string, string>} */
  const kept = new Map();
  return {
    getItem: (/** @type {string} */ key) => kept.get(key) ?? null,
    setItem: (/** @type {string} */ key, /** @type {string} */ value) => void kept.set(key, value),
  };
}

/** @param {OpenAlarms} alarms */
const texts = (alarms) => alarms.sorted().map((one) => one.text);

test("the worst and newest alarm is first", () => {
  const alarms = new OpenAlarms(storage());
  alarms.begin("run");
  const worst = alarms.add([
    entry(1, "old alarm"),
    entry(2, "new alarm"),
    entry(3, "warning", { level: "warning" }),
    entry(4, "information", { level: "info" }),
  ]);
  assert.equal(worst, 2);
  assert.deepEqual(texts(alarms), ["new alarm", "old alarm", "warning"]);
});

test("a newer alarm of the same condition replaces the older one", () => {
  const alarms = new OpenAlarms(storage());
  alarms.begin("run");
  alarms.add([
    entry(1, "battery at 20 %", { key: "battery-low 1" }),
    entry(2, "battery at 18.5 %", { key: "battery-low 1" }),
    entry(3, "battery at 18.5 %", { key: "battery-low 2" }),
  ]);
  assert.deepEqual(
    alarms.sorted().map((one) => one.n),
    [3, 2],
  );
});

test("an alarm ends with its condition", () => {
  const alarms = new OpenAlarms(storage());
  alarms.begin("run");
  alarms.add([
    entry(1, "link down", { key: "link-down 1" }),
    entry(2, "link down", { key: "link-down 2" }),
    entry(3, "heard again", { level: "info", key: "heard-again 1", ends: ["link-stale 1", "link-down 1"] }),
  ]);
  assert.deepEqual(
    alarms.sorted().map((one) => one.key),
    ["link-down 2"],
  );
});

test("entries that were seen are not new again", () => {
  const alarms = new OpenAlarms(storage());
  alarms.begin("run");
  const log = [entry(1, "lost")];
  assert.equal(alarms.add(log), 2);
  alarms.acknowledge(alarms.sorted());
  assert.equal(alarms.add(log), 0);
  assert.deepEqual(texts(alarms), []);
});

test("an acknowledged alarm stays so when the page loads again, and comes back in another run", () => {
  const kept = storage();
  const before = new OpenAlarms(kept);
  before.begin("run");
  before.add([entry(1, "lost")]);
  before.acknowledge(before.sorted());

  const after = new OpenAlarms(kept);
  after.begin("run");
  after.add([entry(7, "lost", { t_s: 1 }), entry(8, "lost again", { t_s: 8 })]);
  assert.deepEqual(texts(after), ["lost again"]);
  after.begin("other run");
  after.add([entry(7, "lost", { t_s: 1 })]);
  assert.deepEqual(texts(after), ["lost"]);
});

test("a newer alarm is not acknowledged with the older one that it has replaced on the screen", () => {
  const alarms = new OpenAlarms(storage());
  alarms.begin("run");
  alarms.add([entry(1, "battery at 20 %")]);
  const shown = alarms.sorted();
  alarms.add([entry(2, "battery at 10 %")]);
  alarms.acknowledge(shown);
  assert.deepEqual(texts(alarms), ["battery at 10 %"]);
});

test("proposed plans and refused orders are shown elsewhere", () => {
  const alarms = new OpenAlarms(storage());
  alarms.begin("run");
  alarms.add([
    entry(1, "plan 1", { kind: "Proposal", level: "warning" }),
    entry(2, "refused", { kind: "OrderAnswer", level: "warning" }),
    entry(3, "failed", { kind: "OrderAnswer" }),
  ]);
  assert.deepEqual(texts(alarms), ["failed"]);
});
