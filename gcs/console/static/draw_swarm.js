// Drawing of what moves: trails, routes, vehicles, and the lines to the targets that they are pinned to.

/**
 * @import { AgentRecord, Point, Route, TargetRecord, Trail } from "../page_types.d.ts"
 * @import { Colour, Context } from "./canvas.js"
 * @import { Labels } from "./map_labels.js"
 * @import { Selection } from "./selection.js"
 * @import { View } from "./map_view.js"
 *
 * @typedef {object} RouteStyle
 * @property {string} colour
 * @property {number} width
 * @property {number[]} dash
 * @property {Set<number>} selected vehicles
 * @property {Record<string, number>} loiter radius of each vehicle
 */

import { addLine, beginDisc, strokeLine } from "./canvas.js";
import { targetName, vehicleName } from "./format.js";

const MIN_LOITER_PX = 6;

/**
 * @param {Context} ctx
 * @param {View} view
 * @param {Iterable<Trail>} trails
 * @param {Colour} colour
 */
export function drawTrails(ctx, view, trails, colour) {
  ctx.strokeStyle = colour("vehicle");
  ctx.lineWidth = 1.2;
  ctx.globalAlpha = 0.45;
  ctx.beginPath();
  for (const trail of trails) addLine(ctx, view, trail);
  ctx.stroke();
  ctx.globalAlpha = 1;
}

/**
 * Draw routes; of vehicles that fly, only what is ahead. The server says how many points each has passed.
 *
 * @param {Context} ctx
 * @param {View} view
 * @param {Route[]} routes
 * @param {Pick<AgentRecord, "vehicle" | "position_m" | "points_passed">[]} flying
 * @param {RouteStyle} style
 */
export function drawRoutes(ctx, view, routes, flying, style) {
  const vehicles = new Map(flying.map((one) => [one.vehicle, one]));
  ctx.strokeStyle = style.colour;
  for (const route of routes) {
    const isFaint = style.selected.size > 0 && !style.selected.has(route.vehicle);
    ctx.globalAlpha = isFaint ? 0.35 : 0.9;
    ctx.setLineDash(style.dash);
    ctx.lineWidth = style.width;
    ctx.beginPath();
    addLine(ctx, view, shownPart(route.points_m, vehicles.get(route.vehicle)));
    ctx.stroke();
    drawMeeting(ctx, view, route, style.loiter[route.vehicle]);
  }
  ctx.setLineDash([]);
  ctx.globalAlpha = 1;
}

/**
 * @param {Point[]} points
 * @param {Pick<AgentRecord, "position_m" | "points_passed">} [vehicle]
 */
function shownPart(points, vehicle) {
  if (!vehicle?.position_m) return points;
  return [vehicle.position_m, ...points.slice(Math.min(vehicle.points_passed, points.length - 1))];
}

/**
 * Draw where vehicle and target will meet, and the circle that follows.
 *
 * @param {Context} ctx
 * @param {View} view
 * @param {Route} route
 * @param {number} radius
 */
function drawMeeting(ctx, view, route, radius) {
  const [east, north] = route.points_m[route.points_m.length - 1];
  ctx.lineWidth = 1.2;
  ctx.setLineDash([]);
  beginDisc(ctx, view, [east, north, 3 / view.scale]);
  ctx.stroke();
  if (radius * view.scale < MIN_LOITER_PX) return;
  const [centreEast, centreNorth] = route.wait_m ?? [east, north];
  ctx.setLineDash([2, 3]);
  beginDisc(ctx, view, [centreEast, centreNorth, radius]);
  ctx.stroke();
}

/**
 * Draw dotted lines from vehicles to the targets that they are pinned to.
 *
 * @param {Context} ctx
 * @param {View} view
 * @param {AgentRecord[]} vehicles
 * @param {Map<string, TargetRecord>} targets
 * @param {Colour} colour
 */
export function drawPins(ctx, view, vehicles, targets, colour) {
  ctx.strokeStyle = colour("advisory");
  ctx.lineWidth = 1.5;
  ctx.setLineDash([2, 4]);
  ctx.beginPath();
  for (const { position_m: at, status, pinned } of vehicles) {
    const target = pinned === null ? undefined : targets.get(targetName(pinned));
    if (target && status === "active") addLine(ctx, view, [at, target.position_m]);
  }
  ctx.stroke();
  ctx.setLineDash([]);
}

/**
 * @param {Context} ctx
 * @param {View} view
 * @param {AgentRecord[]} vehicles
 * @param {Selection} selection
 * @param {Labels} labels
 * @param {Colour} colour
 */
export function drawVehicles(ctx, view, vehicles, selection, labels, colour) {
  const { font } = ctx;
  ctx.textAlign = "left";
  ctx.font = `600 ${font}`;
  for (const vehicle of vehicles) {
    if (vehicle.status === "lost" || vehicle.status === "down") {
      if (vehicle.lost_at_m) drawLost(ctx, view, vehicle, vehicle.lost_at_m, labels, colour("warning"));
      continue;
    }
    if (!vehicle.position_m) continue;
    const [x, y] = [view.x(vehicle.position_m[0]), view.y(vehicle.position_m[1])];
    const isSelected = selection.has(vehicle.vehicle);
    const tint = tintOf(vehicle);
    ctx.fillStyle = colour(tint);
    if (isSelected) drawHalo(ctx, x, y, colour("advisory"));
    else ctx.strokeStyle = colour(tint);
    beginArrow(ctx, x, y, vehicle.course_rad ?? 0);
    if (vehicle.is_late)
      ctx.stroke(); // hollow: its position is old
    else ctx.fill();
    labels.draw(vehicleName(vehicle.vehicle), x + 10, y - 5, tint !== "vehicle" || isSelected);
  }
  ctx.font = font;
}

/**
 * @param {Context} ctx
 * @param {View} view
 * @param {AgentRecord[]} vehicles
 * @param {Labels} labels
 * @param {Colour} colour
 */
export function drawAltitudes(ctx, view, vehicles, labels, colour) {
  ctx.textAlign = "left";
  ctx.fillStyle = colour("dim");
  for (const { position_m: at, alt_rel_m: alt, agl_m: agl, status } of vehicles) {
    if (!at || alt === null || status === "lost") continue;
    const above = agl === null ? "" : `, ${agl.toFixed(0)} AGL`;
    labels.draw(`${alt.toFixed(0)} m${above}`, view.x(at[0]) + 10, view.y(at[1]) + 9);
  }
}

/**
 * Draw a ring around what is selected.
 *
 * @param {Context} ctx
 * @param {number} x
 * @param {number} y
 * @param {string} tint
 */
export function drawHalo(ctx, x, y, tint) {
  ctx.strokeStyle = tint;
  ctx.lineWidth = 2;
  ctx.beginPath();
  ctx.arc(x, y, 14, 0, 2 * Math.PI);
  ctx.stroke();
}

/** @param {AgentRecord} vehicle */
function tintOf(vehicle) {
  if (vehicle.is_position_doubted) return "warning";
  if (vehicle.is_late || vehicle.authority !== "ours") return "caution";
  return vehicle.status === "arrived" ? "done" : "vehicle";
}

/**
 * @param {Context} ctx
 * @param {number} x
 * @param {number} y
 * @param {number} course
 */
function beginArrow(ctx, x, y, course) {
  const [sin, cos] = [Math.sin(course), Math.cos(course)];
  ctx.lineWidth = 1.5;
  ctx.beginPath();
  for (const [right, forward] of [
    [0, 10],
    [6, -6],
    [0, -3],
    [-6, -6],
  ]) {
    ctx.lineTo(x + right * cos + forward * sin, y + right * sin - forward * cos);
  }
  ctx.closePath();
}

/**
 * Draw a cross where a vehicle was seen last.
 *
 * @param {Context} ctx
 * @param {View} view
 * @param {AgentRecord} vehicle
 * @param {Point} at
 * @param {Labels} labels
 * @param {string} tint
 */
function drawLost(ctx, view, { vehicle, status }, at, labels, tint) {
  const [x, y] = [view.x(at[0]), view.y(at[1])];
  ctx.strokeStyle = ctx.fillStyle = tint;
  ctx.lineWidth = 2;
  for (const side of [-6, 6]) {
    strokeLine(ctx, [
      [x - 6, y + side],
      [x + 6, y - side],
    ]);
  }
  labels.draw(`${vehicleName(vehicle)} ${status}`, x + 10, y + 4, true);
}
