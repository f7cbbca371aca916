// A profile would show a vehicle clear of the ground, or of another vehicle, where it is not.

/**
 * @import { AgentRecord, ElevationMap, MissionInfo, NoFlyZone, Point, Route } from "../../../gcs/console/page_types.d.ts"
 */

import assert from "node:assert/strict";
import { test } from "node:test";
import { Ground } from "../../../gcs/console/static/ground_picture.js";
import {
  aheadOf,
  behindOf,
  crossingsOf,
  othersNear,
  stationAt,
} from "../../../gcs/console/static/height_profile_path.js";
import { crossedZones, partsInside } from "../../../gcs/console/static/height_profile_zones.js";

/** @param {Partial<AgentRecord>} more */
const vehicle = (more) =>
  /** @type {AgentRecord} */ ({
    vehicle: 1,
    status: "active",
    position_m: [0, 0],
    alt_msl_m: 700,
    alt_rel_m: 100,
    points_passed: 1,
    ...more,
  });

/** @param {Partial<Route>} more */
const route = (more) =>
  /** @type {Route} */ ({
    vehicle: 1,
    points_m: /** @type {Point[]} */ ([
      [-100, 0],
      [100, 0],
      [100, 200],
    ]),
    wait_m: null,
    heights_msl_m: null,
    layer: 1,
    ...more,
  });

const flat = /** @type {MissionInfo} */ ({ elevation: null, layers_rel_m: [100, 120] });
const steep = /** @type {MissionInfo} */ ({
  elevation: /** @type {ElevationMap} */ ({}),
  layers_rel_m: [100],
});

test("ground is read between nodes, and unknown beyond them", () => {
  const steps = new Uint16Array([0, 10, 20, 100, 110, 120]);
  const heights = btoa(String.fromCharCode(...new Uint8Array(steps.buffer)));
  const ground = new Ground({
    origin_m: [1000, 2000],
    spacing_m: 10,
    shape: [2, 3],
    lowest_msl_m: 500,
    step_m: 0.5,
    heights,
    min_agl_m: 50,
    max_agl_m: 120,
  });
  assert.equal(ground.at([1000, 2000]), 500);
  assert.equal(ground.at([1020, 2010]), 560);
  assert.equal(ground.at([1015, 2005]), 532.5);
  assert.equal(ground.at([1020.1, 2005]), null);
  assert.equal(ground.at([1000, 1999]), null);
  /** @type {number[][]} */
  const lines = [];
  ground.contour(525, (...line) => lines.push(line));
  assert.deepEqual(lines, [
    [1, 0.4, 0, 0.5],
    [2, 0.3, 1, 0.4],
  ]);
  assert.ok(ground.brightness(0, 1) < 1, "a slope to the south is darker than level ground");
});

test("over terrain the route has its own heights above sea level, from the vehicle on", () => {
  const ahead = aheadOf(
    steep,
    vehicle({}),
    route({ wait_m: [100, 260], heights_msl_m: [690, 710, 730, 735] }),
  );
  assert.deepEqual(
    ahead.map(({ at, height }) => [at, height]),
    [
      [0, 700],
      [100, 710],
      [300, 730],
      [360, 735],
    ],
  );
  assert.deepEqual(stationAt(ahead, 200), { at: 200, place: [100, 100], height: 720 });
});

test("over flat ground heights are above home, and the route has that of its layer", () => {
  const ahead = aheadOf(flat, vehicle({}), route({}));
  assert.deepEqual(
    ahead.map((one) => one.height),
    [100, 120, 120],
  );
  assert.deepEqual(aheadOf(flat, vehicle({ position_m: null }), route({})), []);
});

test("where a vehicle was not heard, no flown height is shown", () => {
  const [now] = aheadOf(steep, vehicle({}), undefined);
  const runs = behindOf([[-300, 0, 660], [-200, 0, 670], null, [-50, 0, 690]], now, 0, 0);
  assert.deepEqual(
    runs.map((run) => run.map(({ at, height }) => [at, height])),
    [
      [
        [-300, 660],
        [-200, 670],
      ],
      [
        [-50, 690],
        [0, 700],
      ],
    ],
  );
});

test("other vehicles are shown at their heights where they are near, and where their routes cross", () => {
  const ahead = aheadOf(steep, vehicle({}), route({ heights_msl_m: [690, 710, 730] }));
  const others = [
    vehicle({ vehicle: 2, position_m: [50, 40], alt_msl_m: 705 }),
    vehicle({ vehicle: 3, position_m: [50, 900] }),
    vehicle({ vehicle: 4, position_m: [50, 10], status: "down" }),
  ];
  assert.deepEqual(othersNear(ahead, others, 0), [{ vehicle: 2, at: 50, height: 705 }]);
  const crossing = aheadOf(
    steep,
    vehicle({ vehicle: 2, position_m: [60, -50], alt_msl_m: 740, points_passed: 0 }),
    route({ points_m: [[60, 50]], heights_msl_m: [720] }),
  );
  assert.deepEqual(crossingsOf(ahead, 2, crossing), [{ vehicle: 2, at: 60, height: 730 }]);
});

/** @param {Partial<NoFlyZone>} more */
const zone = (more) =>
  /** @type {NoFlyZone} */ ({
    name: "fire",
    disc_m: null,
    polygon_m: [],
    limits: { floor_m: null, ceiling_m: null, reference: "ground" },
    ...more,
  });

/** @type {{ at: number, place: Point, height: number }[]} */
const straight = [
  { at: -100, place: [0, 0], height: 100 },
  { at: 0, place: [100, 0], height: 100 },
  { at: 300, place: [400, 0], height: 100 },
];

test("a path is in a zone from one edge to the other, over its own corners, and as often as it enters", () => {
  assert.deepEqual(partsInside(straight, zone({ disc_m: [150, 0, 100] })), [[-50, 150]]);
  assert.deepEqual(partsInside(straight, zone({ disc_m: [150, 200, 100] })), []);
  assert.deepEqual(partsInside(straight, zone({ disc_m: [150, 0, 1000] })), [[-100, 300]]);
  /** @type {Point[]} */
  const twoArms = [
    [120, -50],
    [360, -50],
    [360, 50],
    [300, 50],
    [300, -20],
    [180, -20],
    [180, 50],
    [120, 50],
  ];
  const found = partsInside(straight, zone({ polygon_m: twoArms }));
  assert.deepEqual(
    found.map((part) => part.map(Math.round)),
    [
      [20, 80],
      [200, 260],
    ],
  );
});

test("a zone has its heights above sea level over terrain, and above home over flat ground", () => {
  const home = { origin_alt_m: 70 };
  /** @type {(limits: NoFlyZone["limits"], mission: MissionInfo) => number[]} */
  const heights = (limits, mission) => {
    const groundAt = (/** @type {Point} */ [east]) => 500 + east;
    const [{ edges }] = crossedZones(straight, [zone({ disc_m: [200, 0, 100], limits })], mission, groundAt);
    const { floor, ceiling } = edges[0];
    return [floor, ceiling];
  };
  const over = { ...steep, ...home };
  const level = { ...flat, ...home };
  assert.deepEqual(heights({ floor_m: 10, ceiling_m: 60, reference: "ground" }, over), [610, 660]);
  assert.deepEqual(heights({ floor_m: 10, ceiling_m: 60, reference: "msl" }, over), [10, 60]);
  assert.deepEqual(heights({ floor_m: null, ceiling_m: 60, reference: "home" }, over), [-Infinity, 130]);
  assert.deepEqual(heights({ floor_m: 10, ceiling_m: null, reference: "ground" }, level), [10, Infinity]);
  assert.deepEqual(heights({ floor_m: 10, ceiling_m: 100, reference: "msl" }, level), [-60, 30]);
});
