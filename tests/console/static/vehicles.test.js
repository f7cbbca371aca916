// A table would hide what an operator must know, or a key would select another vehicle.

/** @import { AgentRecord } from "../../../gcs/console/page_types.d.ts" */

import assert from "node:assert/strict";
import { test } from "node:test";
import { FrameRate } from "../../../gcs/console/static/frame_rate.js";
import { Digits } from "../../../gcs/console/static/keyboard.js";
import { Selection } from "../../../gcs/console/static/selection.js";
import { orderedOf, stalenessOf } from "../../../gcs/console/static/targets_panel.js";
import { missionCell, targetCell } from "../../../gcs/console/static/vehicle_table.js";

/** @param {Partial<AgentRecord>} more */
function vehicle(more) {
  const quiet = {
    status: "active",
    problems: [],
    reason: "",
    upload: "",
    has_failed: false,
    is_verified: true,
  };
  return /** @type {AgentRecord} */ ({
    ...quiet,
    target: null,
    proposed_target: null,
    pinned: null,
    ...more,
  });
}

test("the worst about a mission is said, and nothing of a lost vehicle's", () => {
  const all = { problems: ["no GPS"], reason: "held", upload: "read-back", has_failed: true };
  assert.deepEqual(missionCell(vehicle(all)), ["no GPS", "bad"]);
  assert.deepEqual(missionCell(vehicle({ ...all, problems: [] })), ["held", "fair"]);
  assert.deepEqual(missionCell(vehicle({ upload: "read-back" })), ["upload: read-back", "active"]);
  assert.deepEqual(missionCell(vehicle({ has_failed: true })), ["upload failed", "bad"]);
  assert.deepEqual(missionCell(vehicle({})), ["verified", "faint"]);
  assert.deepEqual(missionCell(vehicle({ ...all, status: "lost" })), ["–", "faint"]);
});

test("a proposed target is marked as such, and a pin that is not obeyed stands out", () => {
  assert.equal(targetCell(vehicle({ proposed_target: [0, 1] })), "T0.1?");
  assert.equal(targetCell(vehicle({ target: [0, 1], pinned: [0, 1] })), "pin T0.1");
  assert.deepEqual(targetCell(vehicle({ target: [0, 1], pinned: [0, 2] })), ["T0.1, pin T0.2", "fair"]);
});

test("what was ordered about a target is listed; priority 0 is an order, too", () => {
  assert.equal(orderedOf({ is_ignored: false, priority: null, pinned: [] }), "");
  assert.equal(orderedOf({ is_ignored: true, priority: 0, pinned: [3] }), "ignored, priority 0, pinned 3");
});

test("targets are called old only if no sensor tells of them in time", () => {
  assert.equal(stalenessOf([]), ", no scan yet");
  assert.equal(
    stalenessOf([
      { scan_age_s: 9, state: "silent" },
      { scan_age_s: 0.2, state: "" },
    ]),
    "",
  );
  assert.equal(
    stalenessOf([
      { scan_age_s: 9, state: "silent" },
      { scan_age_s: 4, state: "late" },
    ]),
    ", no scan for 4.0 s",
  );
});

test("digits that follow one another are one number", () => {
  const digits = new Digits();
  assert.equal(digits.isOpen(0), false);
  assert.equal(digits.add("1", 1000), "1");
  assert.equal(digits.add("2", 1400), "12");
  assert.equal(digits.isOpen(1900), true);
  assert.equal(digits.add("3", 2100), "3");
  digits.end();
  assert.equal(digits.add("4", 2200), "4");
});

test("a click selects one vehicle, with a modifier key it adds or removes one", () => {
  const selection = new Selection();
  const plain = { shiftKey: false, ctrlKey: false, metaKey: false };
  const shift = { ...plain, shiftKey: true };
  selection.toggle(1, plain);
  selection.toggle(2, shift);
  assert.deepEqual([...selection.ids], [1, 2]);
  selection.toggle(1, shift);
  assert.deepEqual([...selection.ids], [2]);
  selection.toggle(2, plain);
  assert.deepEqual([...selection.ids], []);
  selection.set([1, 2]);
  selection.toggle(1, plain);
  assert.deepEqual([...selection.ids], [1]);
});

test("the rate of frames begins anew with another vehicle and with an earlier time", () => {
  const rate = new FrameRate();
  const record = (/** @type {number} */ t_s, /** @type {number} */ frames, vehicle = 1) => ({
    t_s,
    agent: { vehicle },
    link: { frames },
  });
  rate.add(record(10, 100));
  assert.equal(rate.perSecond, null);
  rate.add(record(11, 120));
  rate.add(record(12, 140));
  assert.equal(rate.perSecond, 20);
  rate.add(record(5, 50));
  assert.equal(rate.perSecond, null);
  rate.add(record(20, 900, 2));
  assert.equal(rate.perSecond, null);
});
