// Points in the local frame.

/** @import { Point } from "../page_types.d.ts" */

/**
 * @param {Point} a
 * @param {Point} b
 */
export function distance([eastA, northA], [eastB, northB]) {
  return Math.hypot(eastB - eastA, northB - northA);
}

/**
 * Return the mean of points.
 *
 * @param {Point[]} points
 * @returns {Point}
 */
export function centroid(points) {
  const east = points.reduce((sum, point) => sum + point[0], 0) / points.length;
  const north = points.reduce((sum, point) => sum + point[1], 0) / points.length;
  return [east, north];
}

/**
 * Return a point in whole metres, as orders have it.
 *
 * @param {Point} point
 * @returns {Point}
 */
export function whole([east, north]) {
  return [Math.round(east), Math.round(north)];
}

/**
 * Return 1, 2 or 5 times a power of ten: the round length nearest above the given one.
 *
 * @param {number} length
 */
export function roundLength(length) {
  const power = 10 ** Math.floor(Math.log10(length));
  return power * ([1, 2, 5].find((step) => step * power >= length) ?? 10);
}
