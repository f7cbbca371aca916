// A click on the map would select, measure or close another place than the one that is shown there.

import assert from "node:assert/strict";
import { test } from "node:test";
import { View } from "../../../gcs/console/static/map_view.js";

function viewOf(width = 800, height = 600) {
  return Object.assign(new View(), { width, height, east: 500, north: 400, scale: 0.5 });
}

test("a place is where it is drawn, with north up", () => {
  const view = viewOf();
  assert.deepEqual(view.place(view.x(620), view.y(310)), [620, 310]);
  assert.ok(view.y(500) < view.y(400));
  assert.ok(view.x(600) > view.x(500));
});

test("what is under the pointer stays there when it zooms", () => {
  const view = viewOf();
  const before = view.place(100, 50);
  view.zoom(3, 100, 50);
  const after = view.place(100, 50);
  assert.ok(Math.hypot(after[0] - before[0], after[1] - before[1]) < 1e-9);
  assert.equal(view.scale, 1.5);
});

test("the scale stays within bounds", () => {
  const view = viewOf();
  view.zoom(1e9);
  assert.equal(view.scale, 20);
  view.zoom(1e-9);
  assert.equal(view.scale, 0.005);
});

test("a drag moves the map with the pointer", () => {
  const view = viewOf();
  const [x, y] = [view.x(620), view.y(310)];
  view.pan(30, -20);
  assert.deepEqual([view.x(620), view.y(310)], [x + 30, y - 20]);
});

test("all points are shown when they are to fit", () => {
  const view = viewOf();
  /** @type {[number, number][]} */
  const points = [
    [-300, 20],
    [4000, 900],
    [100, 2500],
  ];
  view.fit(points, 40);
  for (const point of points) assert.ok(view.shows(point));
  const scale = view.scale;
  view.fit([]);
  assert.equal(view.scale, scale);
});

test("a single point is not shown at an endless scale", () => {
  const view = viewOf();
  view.fit([[10, 20]]);
  assert.deepEqual(view.place(400, 300), [10, 20]);
  assert.ok(view.scale < 10);
});
