// A chart would show another time or another value than its axes say.

/** @import { Mark } from "../../../gcs/console/page_types.d.ts" */

import assert from "node:assert/strict";
import { test } from "node:test";
import { topOf } from "../../../gcs/console/static/line_chart.js";
import { nearestMark } from "../../../gcs/console/static/run_marks.js";
import { TimeAxis } from "../../../gcs/console/static/time_axis.js";

test("a span that is drawn backwards or beyond the run is shown within it", () => {
  const axis = new TimeAxis();
  axis.to = 100;
  axis.zoom([60, 40]);
  assert.deepEqual(axis.span, [40, 60]);
  axis.zoom([90, 140]);
  assert.deepEqual(axis.span, [90, 100]);
  axis.zoom([-20, 30]);
  assert.deepEqual(axis.span, [0, 30]);
  axis.zoom([50, 50.1]);
  assert.deepEqual(axis.span, [50, 51]);
  axis.zoom(null);
  assert.deepEqual(axis.span, [0, 100]);
});

test("the last minute of a run that goes on moves on with it", () => {
  const axis = new TimeAxis();
  axis.to = 40;
  axis.zoom(null, 60);
  assert.equal(axis.isWhole, false);
  assert.deepEqual(axis.span, [0, 40]);
  axis.to = 100;
  assert.deepEqual(axis.span, [40, 100]);
  axis.zoom([50, 60]);
  axis.to = 110;
  assert.deepEqual(axis.span, [50, 60]);
  axis.zoom(null);
  assert.deepEqual(axis.span, [0, 110]);
  assert.equal(axis.isWhole, true);
});

test("values are read under the pointer, else at the time of the replay, else at the end", () => {
  const axis = new TimeAxis();
  axis.to = 100;
  assert.equal(axis.read, 100);
  axis.now = 20;
  assert.equal(axis.read, 20);
  axis.point(30);
  assert.equal(axis.read, 30);
  axis.point(130);
  assert.equal(axis.read, 20);
});

test("times on the axis are round and have their room", () => {
  const axis = new TimeAxis();
  axis.to = 100;
  assert.deepEqual(axis.roundTimes(25), [0, 30, 60, 90]);
  axis.zoom([31, 36]);
  assert.deepEqual(axis.roundTimes(1.5), [32, 34, 36]);
});

test("the end of a scale is above all values with their spread", () => {
  assert.deepEqual(topOf([{ values: [1, null, 7], spread: [0, null, 2] }], 1), { step: 5, max: 10 });
  assert.deepEqual(topOf([], 100), { step: 50, max: 100 });
  const { max } = topOf([{ values: [0.02] }], 0.001);
  assert.ok(max >= 0.02 && max < 0.04);
});

test("the nearest mark is found, and none that is far", () => {
  /** @type {Mark[]} */
  const marks = [3, 10, 12].map((at) => ({ t_s: at, kind: "lost", text: "", code: "", key: "" }));
  assert.equal(nearestMark(marks, 11.2, 2)?.t_s, 12);
  assert.equal(nearestMark(marks, 6.5, 2), undefined);
});
