// An order would close another area than the one that was drawn.

/**
 * @import { VerticalLimits } from "../../../gcs/console/page_types.d.ts"
 * @import { Shape } from "../../../gcs/console/static/zone_tools.js"
 */

import assert from "node:assert/strict";
import { test } from "node:test";
import { ZoneEdit } from "../../../gcs/console/static/zone_edit.js";
import { CircleTool, PolygonTool } from "../../../gcs/console/static/zone_tools.js";
import { heights, mistakeIn } from "../../../gcs/console/static/zones.js";

/** @type {VerticalLimits} */
const OPEN = { floor_m: null, ceiling_m: null, reference: "ground" };

function shapes() {
  /** @type {Shape[]} */
  const found = [];
  return { found, done: (/** @type {Shape} */ shape) => void found.push(shape) };
}

test("a circle has the centre that was pressed and goes through the point of the release", () => {
  const { found, done } = shapes();
  const tool = new CircleTool(done);
  tool.down([100.4, 200]);
  tool.up(); // a click is no circle
  tool.down([100.4, 200]);
  tool.drag([130, 240]);
  tool.drag([100.4, 250]);
  tool.up();
  assert.deepEqual(found, [{ circle: [100, 200, 50] }]);
});

test("a polygon is closed by a click on its first corner, once it has three", () => {
  const { found, done } = shapes();
  const tool = new PolygonTool(done);
  tool.click([0, 0]);
  tool.click([100, 0]);
  tool.click([100, 100]);
  assert.deepEqual(found, []);
  tool.click([3, 3]);
  assert.deepEqual(found, [
    {
      polygon: [
        [0, 0],
        [100, 0],
        [100, 100],
      ],
    },
  ]);
});

test("the handles of a circle move it and set its radius", () => {
  const edit = new ZoneEdit(
    { name: "z", disc_m: [0, 0, 50], polygon_m: [], limits: OPEN },
    () => {},
    () => {},
  );
  assert.equal(edit.down([200, 200]), false);
  assert.equal(edit.down([2, 2]), true);
  edit.drag([10, 20]);
  edit.up();
  assert.equal(edit.down([60, 20]), true);
  edit.drag([90, 20]);
  assert.deepEqual(edit.shape(), { circle: [10, 20, 80] });
  edit.drag([10, 20]);
  assert.deepEqual(edit.shape(), { circle: [10, 20, 5] });
});

test("the handles of a polygon move it and each corner, and the zone that is shown stays as it is", () => {
  /** @type {[number, number][]} */
  const polygon = [
    [0, 0],
    [90, 0],
    [0, 90],
  ];
  const edit = new ZoneEdit(
    { name: "z", disc_m: null, polygon_m: polygon, limits: OPEN },
    () => {},
    () => {},
  );
  edit.down([30, 30]);
  edit.drag([40, 30]);
  edit.up();
  edit.down([100, 0]);
  edit.drag([200, 0]);
  assert.deepEqual(edit.shape(), {
    polygon: [
      [10, 0],
      [200, 0],
      [10, 90],
    ],
  });
  assert.deepEqual(polygon[1], [90, 0]);
});

test("names and numbers that the service would refuse are not sent", () => {
  assert.equal(mistakeIn("zone-1", { circle: [0, 0, 10] }), "");
  assert.match(mistakeIn("zone 1", { circle: [0, 0, 10] }), /^Name/);
  assert.match(mistakeIn("zone-1", { circle: [0, Number.NaN, 10] }), /^Expected/);
  assert.match(mistakeIn("zone-1", { circle: [0, 0, 0] }), /^Expected/);
});

test("a zone that is moved keeps its floor and ceiling", () => {
  /** @type {VerticalLimits} */
  const limits = { floor_m: null, ceiling_m: 300, reference: "msl" };
  assert.deepEqual(heights(limits), limits);
  assert.deepEqual(heights(OPEN), {});
});
