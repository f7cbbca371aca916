// An operator would misread a number.

import assert from "node:assert/strict";
import { test } from "node:test";
import {
  duration,
  megabytes,
  metres,
  named,
  number,
  seconds,
  utc,
} from "../../../gcs/console/static/format.js";

test("what is not known is a dash, and 0 is not", () => {
  for (const format of [number, seconds, duration, metres, megabytes]) {
    assert.equal(format(null), "–");
    assert.equal(format(undefined), "–");
    assert.match(format(0), /^0/);
  }
});

test("times have hours only when they need them, and no second 60", () => {
  assert.equal(duration(59.6), "1:00");
  assert.equal(duration(3599), "59:59");
  assert.equal(duration(3661), "1:01:01");
  assert.equal(duration(-3), "0:00");
  assert.equal(seconds(99.94), "99.9 s");
  assert.equal(seconds(100), "1:40");
});

test("lengths and sizes change their unit", () => {
  assert.equal(metres(-9999), "-9999 m");
  assert.equal(metres(10400), "10.4 km");
  assert.equal(megabytes(3.14), "3.1 MB");
  assert.equal(megabytes(999), "999 MB");
  assert.equal(megabytes(12345), "12 GB");
});

test("the time of day is that of UTC", () => {
  assert.equal(utc(Date.UTC(2024, 0, 2, 3, 4, 5)), "03:04:05");
});

test("of many names some are left out, and their number is said", () => {
  assert.equal(named(["1", "2"], 2), "1, 2");
  assert.equal(named(["1", "2", "3"], 2), "1, 2 +1");
});
