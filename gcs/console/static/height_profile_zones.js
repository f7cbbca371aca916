// No-fly zones in a height profile: where the path leads through each, with its floor and ceiling there.

/**
 * @import { MissionInfo, NoFlyZone, Point } from "../page_types.d.ts"
 * @import { Context } from "./canvas.js"
 * @import { Axes } from "./height_profile.js"
 * @import { Station } from "./height_profile_path.js"
 *
 * @typedef {object} Crossing part of a path in a zone
 * @property {string} name
 * @property {{ at: number, floor: number, ceiling: number }[]} edges infinite without a floor, a ceiling
 *
 * @typedef {(place: Point) => number | null} GroundAt height of the ground, if it is known
 */

import { shortened } from "./format.js";
import { distance } from "./geometry.js";
import { intersection, stationAt } from "./height_profile_path.js";

const EDGES = 20; // of the floor and the ceiling of a crossing, which follow the ground
const OPACITY = 0.2;
const MAX_NAME = 16;

/**
 * Return where a path leads through zones, with their heights as the profile shows heights.
 *
 * @param {Station[]} path
 * @param {NoFlyZone[]} zones
 * @param {MissionInfo} mission
 * @param {GroundAt} groundAt
 * @returns {Crossing[]}
 */
export function crossedZones(path, zones, mission, groundAt) {
  return zones.flatMap((zone) => {
    const zeroAt = zeroOf(zone, mission, groundAt);
    return partsInside(path, zone).map(([from, to]) => ({
      name: zone.name,
      edges: Array.from({ length: EDGES + 1 }, (_, index) => {
        const at = from + (index / EDGES) * (to - from);
        const zero = zeroAt(stationAt(path, at).place);
        const { floor_m: floor, ceiling_m: ceiling } = zone.limits;
        return { at, floor: zero + (floor ?? -Infinity), ceiling: zero + (ceiling ?? Infinity) };
      }),
    }));
  });
}

/**
 * @param {Context} ctx
 * @param {Crossing[]} crossings
 * @param {Axes} axes
 * @param {string} tint
 */
export function drawCrossings(ctx, crossings, { x, y, heights: [bottom, top] }, tint) {
  /** @param {number} height */
  const shownY = (height) => y(Math.min(top, Math.max(bottom, height)));
  ctx.strokeStyle = ctx.fillStyle = tint;
  ctx.lineWidth = 1;
  ctx.textAlign = "center";
  for (const { name, edges } of crossings) {
    ctx.beginPath();
    for (const { at, ceiling } of edges) ctx.lineTo(x(at), shownY(ceiling));
    for (const { at, floor } of [...edges].reverse()) ctx.lineTo(x(at), shownY(floor));
    ctx.closePath();
    ctx.globalAlpha = OPACITY;
    ctx.fill();
    ctx.globalAlpha = 1;
    ctx.stroke();
    const middle = edges[EDGES / 2];
    if (middle.ceiling > bottom && middle.floor < top)
      ctx.fillText(shortened(name, MAX_NAME), x(middle.at), shownY(middle.ceiling) + 13);
  }
}

/**
 * Return what the limits of a zone are above: over terrain above sea level, over flat ground above home.
 *
 * @param {NoFlyZone} zone
 * @param {MissionInfo} mission
 * @param {GroundAt} groundAt
 * @returns {(place: Point) => number}
 */
function zeroOf({ limits: { reference } }, { elevation, origin_alt_m: home }, groundAt) {
  if (!elevation) return () => (reference === "msl" ? -home : 0);
  if (reference === "ground") return (place) => groundAt(place) ?? home;
  return () => (reference === "msl" ? 0 : home);
}

/**
 * Return the parts of a path inside a zone, from one distance along it to another.
 *
 * @param {Station[]} path
 * @param {NoFlyZone} zone
 * @returns {[from: number, to: number][]}
 */
export function partsInside(path, zone) {
  /** @type {[number, number][]} */
  const parts = [];
  for (let index = 1; index < path.length; index++) {
    const [a, b] = [path[index - 1], path[index]];
    const shares = [0, ...sharesAtEdge(a.place, b.place, zone), 1].sort((one, other) => one - other);
    for (let k = 1; k < shares.length; k++) {
      if (!isInside(between(a.place, b.place, (shares[k - 1] + shares[k]) / 2), zone)) continue;
      const [from, to] = [shares[k - 1], shares[k]].map((share) => a.at + share * (b.at - a.at));
      const last = parts.at(-1);
      if (last && last[1] === from) last[1] = to;
      else parts.push([from, to]);
    }
  }
  return parts;
}

/**
 * @param {Point} a
 * @param {Point} b
 * @param {number} share
 * @returns {Point}
 */
const between = (a, b, share) => [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])];

/**
 * Return how far along a line it crosses the edge of a zone, from 0 to 1.
 *
 * @param {Point} a
 * @param {Point} b
 * @param {NoFlyZone} zone
 */
function sharesAtEdge(a, b, { disc_m: disc, polygon_m: corners }) {
  if (disc) return sharesOnCircle(a, b, [disc[0], disc[1]], disc[2]);
  return corners.flatMap((corner, index) => {
    const shares = intersection(a, b, corner, corners[(index + 1) % corners.length]);
    return shares ? [shares[0]] : [];
  });
}

/**
 * @param {Point} a
 * @param {Point} b
 * @param {Point} centre
 * @param {number} radius
 */
function sharesOnCircle(a, b, centre, radius) {
  const [dx, dy] = [b[0] - a[0], b[1] - a[1]];
  const [x, y] = [a[0] - centre[0], a[1] - centre[1]];
  const length2 = dx ** 2 + dy ** 2;
  const half = x * dx + y * dy;
  const root = half ** 2 - length2 * (x ** 2 + y ** 2 - radius ** 2);
  if (length2 === 0 || root <= 0) return [];
  return [-1, 1].map((side) => (side * Math.sqrt(root) - half) / length2).filter((one) => one > 0 && one < 1);
}

/**
 * @param {Point} place
 * @param {NoFlyZone} zone
 */
function isInside([east, north], { disc_m: disc, polygon_m: corners }) {
  if (disc) return distance([east, north], [disc[0], disc[1]]) < disc[2];
  let isIn = false;
  for (const [index, [x, y]] of corners.entries()) {
    const [nextX, nextY] = corners[(index + 1) % corners.length];
    if (y > north !== nextY > north && east < x + ((north - y) / (nextY - y)) * (nextX - x)) isIn = !isIn;
  }
  return isIn;
}
