// An order would close another area than the one that was drawn.

/**
 * @import { VerticalLimits } from "../../../gcs/console/page_types.d.ts"
 * @import { Shape } from "../../../gcs/console/static/zone_draw_tools.js"
 */

import assert from "node:assert/strict";
import { test } from "node:test";
import { CircleTool, PolygonTool } from "../../../gcs/console/static/zone_draw_tools.js";
import { ZoneEdit } from "../../../gcs/console/static/zone_edit_tool.js";
import { textsOf, zoneOf } from "../../../gcs/console/static/zone_form.js";

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

/** @param {Partial<import("../../../gcs/console/static/zone_form.js").Texts>} changed */
const typed = (changed = {}) => zoneOf({ ...textsOf("zone-1", [100, 200, 50]), ...changed });

test("what was typed is the zone of the order; without heights it has none", () => {
  assert.deepEqual(typed(), { zone: { name: "zone-1", circle: [100, 200, 50] } });
  assert.deepEqual(typed({ reference: "msl" }), typed());
  assert.deepEqual(typed({ floor: " ", ceiling: "60.5", reference: "ground" }), {
    zone: {
      name: "zone-1",
      circle: [100, 200, 50],
      floor_m: null,
      ceiling_m: 60.5,
      reference: "ground",
    },
  });
  assert.deepEqual(typed({ floor: "-20", reference: "home" }).zone?.floor_m, -20);
  assert.deepEqual(typed({ floor: "0", ceiling: "40", reference: "ground" }).zone?.floor_m, 0);
});

test("a polygon needs no centre and no radius", () => {
  /** @type {[number, number][]} */
  const polygon = [
    [0, 0],
    [9, 0],
    [0, 9],
  ];
  const texts = { ...textsOf("zone-1", undefined), ceiling: "60", reference: "home" };
  const zone = { name: "zone-1", polygon, floor_m: null, ceiling_m: 60, reference: "home" };
  assert.deepEqual(zoneOf(texts, polygon), { zone });
});

/** @type {[changed: Parameters<typeof typed>[0], mistake: string][]} */
const MISTAKES = [
  [{ name: "zone 1" }, "Name: letters, digits, _ . - only."],
  [{ east: "abc" }, 'Centre east: expected metres from -10000000 to 10000000, not "abc".'],
  [{ north: "" }, "Centre north: expected metres from -10000000 to 10000000."],
  [{ east: "1e300" }, 'Centre east: expected metres from -10000000 to 10000000, not "1e300".'],
  [{ radius: "0" }, 'Radius: expected metres above 0, up to 1000000, not "0".'],
  [{ radius: "NaN" }, 'Radius: expected metres above 0, up to 1000000, not "NaN".'],
  [{ ceiling: "60" }, "Choose what the heights are above: ground, home or mean sea level."],
  [{ floor: "120 ft", reference: "msl" }, 'Floor: expected metres from -100000 to 100000, not "120 ft".'],
  [{ ceiling: "NaN", reference: "msl" }, 'Ceiling: expected metres from -100000 to 100000, not "NaN".'],
  [{ ceiling: "1e300", reference: "msl" }, 'Ceiling: expected metres from -100000 to 100000, not "1e300".'],
  [
    { floor: "-Infinity", reference: "msl" },
    'Floor: expected metres from -100000 to 100000, not "-Infinity".',
  ],
  [{ floor: "300", ceiling: "100", reference: "msl" }, "The ceiling, 100 m, is not above the floor, 300 m."],
  [{ floor: "60", ceiling: "60" }, "The ceiling, 60 m, is not above the floor, 60 m."],
  [{ ceiling: "-5", reference: "ground" }, "The ceiling, -5 m, is not above the ground."],
  [
    { floor: "-5", reference: "ground" },
    "The floor, -5 m, is below the ground: leave it empty to begin on the ground.",
  ],
];

test("what the service would refuse is not sent, and one sentence says why", () => {
  for (const [changed, mistake] of MISTAKES) assert.deepEqual(typed(changed), { mistake });
});

test("a zone that is moved keeps its floor and ceiling", () => {
  /** @type {VerticalLimits} */
  const limits = { floor_m: null, ceiling_m: 300, reference: "msl" };
  const { zone } = zoneOf(textsOf("fire", [0, 0, 60], limits));
  assert.deepEqual(zone, { name: "fire", circle: [0, 0, 60], ...limits });
  assert.deepEqual(zoneOf(textsOf("fire", [0, 0, 60], OPEN)).zone, { name: "fire", circle: [0, 0, 60] });
});
