// Path of a vehicle for its height profile: where it flew, and what is ahead of it, by distance from it.

/**
 * @import { AgentRecord, MissionInfo, Point, Route, Trail, TrailPoint } from "../page_types.d.ts"
 *
 * @typedef {object} Station
 * @property {number} at distance along the path; negative behind the vehicle
 * @property {Point} place
 * @property {number} height
 *
 * @typedef {object} Other
 * @property {number} vehicle
 * @property {number} at
 * @property {number} height
 */

import { distance } from "./geometry.js";

const NEAR_M = 300; // of other vehicles, from the path
const MIN_BEHIND_M = 1000;

/**
 * Return the height of the axis' zero above mean sea level: over flat ground heights are above home.
 *
 * @param {MissionInfo} mission
 * @param {AgentRecord} vehicle
 */
export function datumOf({ elevation }, { alt_msl_m: msl, alt_rel_m: rel }) {
  return elevation || msl === null || rel === null ? 0 : msl - rel;
}

/**
 * Return what is ahead of a vehicle: its place, then the points that it has not passed.
 *
 * @param {MissionInfo} mission
 * @param {AgentRecord} vehicle
 * @param {Route | undefined} route
 * @returns {Station[]}
 */
export function aheadOf(mission, vehicle, route) {
  const { position_m: place, alt_msl_m: alt } = vehicle;
  if (!place || alt === null) return [];
  const stations = [{ at: 0, place, height: alt - datumOf(mission, vehicle) }];
  if (!route) return stations;
  const { points_m: points, wait_m: wait, heights_msl_m: heights } = route;
  const flown = wait ? [...points, wait] : points;
  const first = Math.min(vehicle.points_passed, flown.length - 1);
  for (let index = first; index < flown.length; index++) {
    const last = stations[stations.length - 1];
    const place = flown[index];
    const height = heights ? heights[index] : mission.layers_rel_m[route.layer];
    stations.push({ at: last.at + distance(last.place, place), place, height });
  }
  return stations;
}

/**
 * Return where a vehicle flew last, in runs without a gap, the oldest first.
 *
 * @param {Trail} trail
 * @param {Station} now
 * @param {number} datum
 * @param {number} ahead length of the path ahead
 */
export function behindOf(trail, now, datum, ahead) {
  /** @type {Station[][]} */
  const runs = [[now]];
  const far = -Math.max(MIN_BEHIND_M, ahead);
  let last = now;
  for (const point of [...trail].reverse()) {
    if (last.at < far) break;
    if (!point) {
      runs.push([]);
      continue;
    }
    last = stationBefore(last, point, datum);
    runs[runs.length - 1].push(last);
  }
  return runs.map((run) => run.reverse()).reverse();
}

/**
 * @param {Station} next
 * @param {TrailPoint} point
 * @param {number} datum
 * @returns {Station}
 */
function stationBefore(next, [east, north, alt], datum) {
  return { at: next.at - distance([east, north], next.place), place: [east, north], height: alt - datum };
}

/**
 * Return the place and the height at a distance along a path.
 *
 * @param {Station[]} path
 * @param {number} at
 * @returns {Station}
 */
export function stationAt(path, at) {
  const after = path.findIndex((one) => one.at >= at);
  if (after <= 0) return path[after ? path.length - 1 : 0];
  const [a, b] = [path[after - 1], path[after]];
  const share = (at - a.at) / (b.at - a.at);
  const place = /** @type {Point} */ (a.place.map((value, k) => value + share * (b.place[k] - value)));
  return { at, place, height: a.height + share * (b.height - a.height) };
}

/**
 * Return other vehicles near a path, each at its nearest point, with their present heights.
 *
 * @param {Station[]} path
 * @param {AgentRecord[]} others
 * @param {number} datum
 * @returns {Other[]}
 */
export function othersNear(path, others, datum) {
  return others.flatMap(({ vehicle, position_m: place, alt_msl_m: alt, status }) => {
    if (!place || alt === null || status === "lost" || status === "down") return [];
    const found = nearest(path, place);
    return found.away < NEAR_M ? [{ vehicle, at: found.at, height: alt - datum }] : [];
  });
}

/**
 * @param {Station[]} path
 * @param {Point} place
 */
function nearest(path, place) {
  let best = { at: 0, away: Infinity };
  for (let index = 1; index < path.length; index++) {
    const [a, b] = [path[index - 1], path[index]];
    const [east, north] = [b.place[0] - a.place[0], b.place[1] - a.place[1]];
    const along = (place[0] - a.place[0]) * east + (place[1] - a.place[1]) * north;
    const share = Math.min(1, Math.max(0, along / Math.max(1e-9, east ** 2 + north ** 2)));
    const away = distance(place, [a.place[0] + share * east, a.place[1] + share * north]);
    if (away < best.away) best = { at: a.at + share * (b.at - a.at), away };
  }
  return best;
}

/**
 * Return where the paths of other vehicles cross what is ahead, with their heights there.
 *
 * @param {Station[]} ahead
 * @param {number} vehicle that flies the other path
 * @param {Station[]} other
 * @returns {Other[]}
 */
export function crossingsOf(ahead, vehicle, other) {
  const found = [];
  for (let i = 1; i < ahead.length; i++) {
    for (let k = 1; k < other.length; k++) {
      const shares = intersection(ahead[i - 1].place, ahead[i].place, other[k - 1].place, other[k].place);
      if (!shares) continue;
      const at = ahead[i - 1].at + shares[0] * (ahead[i].at - ahead[i - 1].at);
      const height = other[k - 1].height + shares[1] * (other[k].height - other[k - 1].height);
      found.push({ vehicle, at, height });
    }
  }
  return found;
}

/**
 * Return how far along two lines they cross, from 0 to 1 of each; null if they do not.
 *
 * @param {Point} a
 * @param {Point} b
 * @param {Point} c
 * @param {Point} d
 * @returns {[number, number] | null}
 */
export function intersection(a, b, c, d) {
  const [ux, uy] = [b[0] - a[0], b[1] - a[1]];
  const [vx, vy] = [d[0] - c[0], d[1] - c[1]];
  const turn = ux * vy - uy * vx;
  if (turn === 0) return null;
  const [x, y] = [c[0] - a[0], c[1] - a[1]];
  const [first, second] = [(x * vy - y * vx) / turn, (x * uy - y * ux) / turn];
  return first >= 0 && first <= 1 && second >= 0 && second <= 1 ? [first, second] : null;
}
