// The map would show what is not so, or an order would close another area than the one that was drawn.

/** @import { AgentRecord, Point, Route } from "../../../gcs/console/page_types.d.ts" */

import assert from "node:assert/strict";
import { test } from "node:test";
import { drawRoutes } from "../../../gcs/console/static/draw_swarm.js";
import { latOf, lonOf, tileColumn, tileRow, toLocal } from "../../../gcs/console/static/geodesy.js";
import { centroid, roundLength } from "../../../gcs/console/static/geometry.js";
import { LateTracks } from "../../../gcs/console/static/late_tracks.js";
import { View } from "../../../gcs/console/static/map_view.js";
import { lengthAndBearing } from "../../../gcs/console/static/measure_tool.js";
import { Trails } from "../../../gcs/console/static/trails.js";

/** Made by gcs.geo.LocalFrame(47.4, 8.5, 420).to_local. */
const REFERENCE = [
  { lat: 47.41, lon: 8.52, east: 1509.54385, north: 1112.054611 },
  { lat: 47.38, lon: 8.47, east: -2265.601211, north: -2223.278868 },
];

/** @param {Partial<AgentRecord>} more */
const vehicle = (more) =>
  /** @type {AgentRecord} */ ({ vehicle: 1, status: "active", is_late: false, position_m: null, ...more });

/** Context that keeps the points of lines. */
function recorder() {
  /** @type {Point[]} */
  const points = [];
  const add = (/** @type {number} */ x, /** @type {number} */ y) => void points.push([x, y]);
  const nothing = () => {};
  const ctx = {
    moveTo: add,
    lineTo: add,
    arc: nothing,
    beginPath: nothing,
    stroke: nothing,
    setLineDash: nothing,
  };
  return { points, ctx: /** @type {CanvasRenderingContext2D} */ (/** @type {unknown} */ (ctx)) };
}

test("of a route only what is ahead of the vehicle is drawn", () => {
  const { points, ctx } = recorder();
  const view = Object.assign(new View(), { width: 0, height: 0, scale: 1 });
  /** @type {Point[]} */
  const route = [
    [0, 0],
    [100, 0],
    [200, 0],
  ];
  const style = { colour: "", width: 1, dash: [], selected: new Set(), loiter: { 1: 0 } };
  /** @type {Route[]} */
  const routes = [
    {
      vehicle: 1,
      target: [0, 1],
      points_m: route,
      length_m: 200,
      layer: 0,
      wait_m: null,
      heights_msl_m: null,
      target_point: -1,
    },
  ];
  drawRoutes(ctx, view, routes, [vehicle({ position_m: [130, 0], points_passed: 2 })], style);
  assert.deepEqual(
    points.map(([x]) => x),
    [130, 200],
  );
  points.length = 0;
  drawRoutes(ctx, view, routes, [vehicle({ position_m: [230, 0], points_passed: 3 })], style);
  assert.deepEqual(
    points.map(([x]) => x),
    [230, 200],
  );
});

test("a trail ends where the vehicle was not heard, and begins again", () => {
  const trails = new Trails();
  trails.begin({ 1: [[0, 0, 600]] });
  trails.add([vehicle({ position_m: [10, 0], alt_msl_m: 610 })]);
  trails.add([vehicle({ position_m: [12, 0], alt_msl_m: 612 })]);
  trails.add([vehicle({ position_m: [20, 0], alt_msl_m: 620, is_late: true })]);
  trails.add([vehicle({ position_m: [30, 0], alt_msl_m: 630, is_late: true })]);
  trails.add([vehicle({ position_m: [40, 0], alt_msl_m: 640 })]);
  assert.deepEqual([...trails.all()], [[[0, 0, 600], [10, 0, 610], null, [40, 0, 640]]]);
});

test("places are where the service's local frame has them", () => {
  const mission = { origin_deg: /** @type {[number, number]} */ ([47.4, 8.5]), origin_alt_m: 420 };
  for (const { lat, lon, east, north } of REFERENCE) {
    const found = toLocal(mission, lat, lon);
    assert.ok(Math.hypot(found[0] - east, found[1] - north) < 1e-3);
  }
});

test("columns and rows of tiles have the corners from which they come", () => {
  for (const zoom of [0, 7, 18]) {
    assert.ok(Math.abs(lonOf(tileColumn(8.5, zoom), zoom) - 8.5) < 1e-9);
    assert.ok(Math.abs(latOf(tileRow(47.4, zoom), zoom) - 47.4) < 1e-9);
  }
  assert.equal(Math.floor(tileColumn(8.5, 10)), 536);
  assert.equal(Math.floor(tileRow(47.4, 10)), 358);
});

test("bearings are clockwise from north", () => {
  assert.equal(lengthAndBearing([0, 0], [0, 100]), "100 m  0°");
  assert.equal(lengthAndBearing([0, 0], [100, 0]), "100 m  90°");
  assert.equal(lengthAndBearing([0, 0], [-100, 0]), "100 m  270°");
});

test("round lengths are 1, 2 or 5 times a power of ten", () => {
  assert.deepEqual([0.3, 1, 3, 6, 170].map(roundLength), [0.5, 1, 5, 10, 200]);
  assert.deepEqual(
    centroid([
      [0, 0],
      [4, 2],
    ]),
    [2, 1],
  );
});

test("late estimates continue the path of their track, and the tracks that ended first are forgotten", () => {
  const late = new LateTracks();
  late.begin({ "T0.1": [[0, 0]] });
  late.add({ "T0.1": [null, [1, 0]] });
  assert.deepEqual(late.paths.get("T0.1"), [[0, 0], null, [1, 0]]);
  for (let number = 0; number < 250; number++)
    late.add({ [`T${number}.9`]: [[0, 0]], "A0.0": [[number, 0]] });
  assert.equal(late.paths.size, 200);
  assert.equal(late.paths.has("T0.1"), false);
  assert.equal(late.paths.get("A0.0")?.length, 250);
  late.begin({});
  assert.equal(late.paths.size, 0);
});
