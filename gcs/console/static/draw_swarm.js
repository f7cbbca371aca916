// What moves: trails, routes, vehicles, and the lines to the targets that they are pinned to.

/**
 * @import { Point, Route, Target, Trail, Vehicle } from "../page_types.d.ts"
 * @import { Colour, Context } from "./canvas.js"
 * @import { Labels } from "./labels.js"
 * @import { Selection } from "./selection.js"
 * @import { View } from "./view.js"
 *
 * @typedef {object} RouteStyle
 * @property {string} colour
 * @property {number} width
 * @property {number[]} dash
 * @property {Set<number>} selected vehicles
 * @property {Record<string, number>} loiter radius of each vehicle
 */

import { addLine, beginDisc, strokeLine } from "./canvas.js";

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
 * @param {Pick<Vehicle, "id" | "at" | "passed">[]} flying
 * @param {RouteStyle} style
 */
export function drawRoutes(ctx, view, routes, flying, style) {
  const vehicles = new Map(flying.map((one) => [one.id, one]));
  ctx.strokeStyle = style.colour;
  for (const route of routes) {
    const isFaint = style.selected.size > 0 && !style.selected.has(route.id);
    ctx.globalAlpha = isFaint ? 0.35 : 0.9;
    ctx.setLineDash(style.dash);
    ctx.lineWidth = style.width;
    ctx.beginPath();
    addLine(ctx, view, shownPart(route.points, vehicles.get(route.id)));
    ctx.stroke();
    drawMeeting(ctx, view, route, style.loiter[route.id]);
  }
  ctx.setLineDash([]);
  ctx.globalAlpha = 1;
}

/**
 * @param {Point[]} points
 * @param {Pick<Vehicle, "at" | "passed">} [vehicle]
 */
function shownPart(points, vehicle) {
  if (!vehicle?.at) return points;
  return [vehicle.at, ...points.slice(Math.min(vehicle.passed, points.length - 1))];
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
  const [east, north] = route.points[route.points.length - 1];
  ctx.lineWidth = 1.2;
  ctx.setLineDash([]);
  beginDisc(ctx, view, [east, north, 3 / view.scale]);
  ctx.stroke();
  if (radius * view.scale < MIN_LOITER_PX) return;
  const [centreEast, centreNorth] = route.wait ?? [east, north];
  ctx.setLineDash([2, 3]);
  beginDisc(ctx, view, [centreEast, centreNorth, radius]);
  ctx.stroke();
}

/**
 * Draw dotted lines from vehicles to the targets that they are pinned to.
 *
 * @param {Context} ctx
 * @param {View} view
 * @param {Vehicle[]} vehicles
 * @param {Map<string, Target>} targets
 * @param {Colour} colour
 */
export function drawPins(ctx, view, vehicles, targets, colour) {
  ctx.strokeStyle = colour("advisory");
  ctx.lineWidth = 1.5;
  ctx.setLineDash([2, 4]);
  ctx.beginPath();
  for (const { at, status, pinned } of vehicles) {
    const target = pinned === null ? undefined : targets.get(pinned);
    if (target && status === "active") addLine(ctx, view, [at, target.at]);
  }
  ctx.stroke();
  ctx.setLineDash([]);
}

/**
 * @param {Context} ctx
 * @param {View} view
 * @param {Vehicle[]} vehicles
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
      if (vehicle.lost_at) drawLost(ctx, view, vehicle, vehicle.lost_at, labels, colour("warning"));
      continue;
    }
    if (!vehicle.at) continue;
    const [x, y] = [view.x(vehicle.at[0]), view.y(vehicle.at[1])];
    const isSelected = selection.has(vehicle.id);
    const tint = tintOf(vehicle);
    ctx.fillStyle = colour(tint);
    if (isSelected) drawHalo(ctx, x, y, colour("advisory"));
    else ctx.strokeStyle = colour(tint);
    beginArrow(ctx, x, y, vehicle.course ?? 0);
    if (vehicle.late)
      ctx.stroke(); // hollow: its position is old
    else ctx.fill();
    labels.draw(vehicle.name, x + 10, y - 5, tint !== "vehicle" || isSelected);
  }
  ctx.font = font;
}

/**
 * @param {Context} ctx
 * @param {View} view
 * @param {Vehicle[]} vehicles
 * @param {Labels} labels
 * @param {Colour} colour
 */
export function drawAltitudes(ctx, view, vehicles, labels, colour) {
  ctx.textAlign = "left";
  ctx.fillStyle = colour("dim");
  for (const { at, alt_m: alt, status } of vehicles) {
    if (at && alt !== null && status !== "lost")
      labels.draw(`${alt.toFixed(0)} m`, view.x(at[0]) + 10, view.y(at[1]) + 9);
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

/** @param {Vehicle} vehicle */
function tintOf(vehicle) {
  if (vehicle.doubted) return "warning";
  if (vehicle.late || vehicle.authority !== "ours") return "caution";
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
 * @param {Vehicle} vehicle
 * @param {Point} at
 * @param {Labels} labels
 * @param {string} tint
 */
function drawLost(ctx, view, { name, status }, at, labels, tint) {
  const [x, y] = [view.x(at[0]), view.y(at[1])];
  ctx.strokeStyle = ctx.fillStyle = tint;
  ctx.lineWidth = 2;
  for (const side of [-6, 6]) {
    strokeLine(ctx, [
      [x - 6, y + side],
      [x + 6, y - side],
    ]);
  }
  labels.draw(`${name} ${status}`, x + 10, y + 4, true);
}
