// Places on the ellipsoid of WGS 84 in the local frame, and in the columns and rows of map tiles.

/** @import { MissionInfo, Point } from "../page_types.d.ts" */

const MAJOR_M = 6378137;
const FLATTENING = 1 / 298.257223563;
export const METRES_PER_DEGREE = 111320;

/** @param {number} degrees */
export const radians = (degrees) => (degrees * Math.PI) / 180;

/**
 * @param {number} lat
 * @param {number} lon
 * @param {number} alt
 */
function ecef(lat, lon, alt) {
  const e2 = FLATTENING * (2 - FLATTENING);
  const normal = MAJOR_M / Math.sqrt(1 - e2 * Math.sin(lat) ** 2);
  const ring = (normal + alt) * Math.cos(lat);
  return [ring * Math.cos(lon), ring * Math.sin(lon), (normal * (1 - e2) + alt) * Math.sin(lat)];
}

/**
 * Return east and north of a place at the height of a mission's origin, as gcs.geo.LocalFrame.to_local.
 *
 * @param {Pick<MissionInfo, "origin_deg" | "origin_alt_m">} mission
 * @param {number} lat
 * @param {number} lon
 * @returns {Point}
 */
export function toLocal({ origin_deg: [lat0, lon0], origin_alt_m: alt }, lat, lon) {
  const [a, b] = [radians(lat0), radians(lon0)];
  const origin = ecef(a, b, alt);
  const [u, v, w] = ecef(radians(lat), radians(lon), alt).map((value, axis) => value - origin[axis]);
  const outward = Math.cos(b) * u + Math.sin(b) * v;
  return [-Math.sin(b) * u + Math.cos(b) * v, -Math.sin(a) * outward + Math.cos(a) * w];
}

/**
 * @param {number} lon
 * @param {number} zoom
 */
export const tileColumn = (lon, zoom) => ((lon + 180) / 360) * 2 ** zoom;

/**
 * @param {number} lat
 * @param {number} zoom
 */
export const tileRow = (lat, zoom) => ((1 - Math.asinh(Math.tan(radians(lat))) / Math.PI) / 2) * 2 ** zoom;

/**
 * @param {number} column
 * @param {number} zoom
 */
export const lonOf = (column, zoom) => (column / 2 ** zoom) * 360 - 180;

/**
 * @param {number} row
 * @param {number} zoom
 */
export const latOf = (row, zoom) =>
  (Math.atan(Math.sinh(Math.PI * (1 - (2 * row) / 2 ** zoom))) * 180) / Math.PI;
