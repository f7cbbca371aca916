// Numbers and names as operators read them. A number that is not known is a dash.

/**
 * @import { Label, VerticalLimits } from "../page_types.d.ts"
 *
 * @typedef {number | null | undefined} Value
 */

const NETWORK = 256; // system ids of each network

/**
 * @param {Value} value
 * @param {number} digits
 * @param {string} unit
 */
export function number(value, digits = 0, unit = "") {
  return value === null || value === undefined ? "–" : value.toFixed(digits) + unit;
}

/** @param {Value} value */
export function seconds(value) {
  if (value === null || value === undefined) return "–";
  return value < 100 ? `${value.toFixed(1)} s` : duration(value);
}

/** @param {Value} value */
export function duration(value) {
  if (value === null || value === undefined) return "–";
  const whole = Math.max(0, Math.round(value));
  const hours = Math.floor(whole / 3600);
  const minutes = Math.floor(whole / 60) % 60;
  const rest = String(whole % 60).padStart(2, "0");
  return hours ? `${hours}:${String(minutes).padStart(2, "0")}:${rest}` : `${minutes}:${rest}`;
}

/** @param {Value} value */
export function metres(value) {
  if (value === null || value === undefined) return "–";
  return Math.abs(value) < 10000 ? `${value.toFixed(0)} m` : `${(value / 1000).toFixed(1)} km`;
}

/** @param {Value} value */
export function megabytes(value) {
  if (value === null || value === undefined) return "–";
  return value < 1000
    ? `${value.toFixed(value < 10 ? 1 : 0)} MB`
    : `${(value / 1000).toFixed(value < 10000 ? 1 : 0)} GB`;
}

/**
 * Return the name of a vehicle: "17", or "2:17" on network 2.
 *
 * @param {number} vehicle
 */
export function vehicleName(vehicle) {
  const network = Math.floor(vehicle / NETWORK);
  return `${network ? `${network}:` : ""}${vehicle % NETWORK}`;
}

/**
 * Return the name of a target: "T12.3", born in scan 12 with index 3.
 *
 * @param {Label} label
 */
export const targetName = ([scan, index]) => `T${scan}.${index}`;

/**
 * Return the time of day, UTC.
 *
 * @param {number} timeMs since 1970
 */
export function utc(timeMs) {
  return new Date(timeMs).toISOString().slice(11, 19);
}

/**
 * Return names, or as many as there is room for.
 *
 * @param {string[]} names
 * @param {number} max
 */
export function named(names, max) {
  return names.length > max ? `${names.slice(0, max).join(", ")} +${names.length - max}` : names.join(", ");
}

/**
 * Return a name, or as much of it as there is room for.
 *
 * @param {string} name
 * @param {number} max
 */
export const shortened = (name, max) => (name.length > max ? `${name.slice(0, max)}…` : name);

const ABOVE = { home: "above home", msl: "MSL", ground: "above ground" };

/**
 * Return the heights of a zone; empty if it reaches from the ground to the sky.
 *
 * @param {VerticalLimits} limits
 */
export function limitsText({ floor_m, ceiling_m, reference }) {
  if (floor_m === null && ceiling_m === null) return "";
  if (ceiling_m === null) return `from ${floor_m} m ${ABOVE[reference]}`;
  if (floor_m === null) return `up to ${ceiling_m} m ${ABOVE[reference]}`;
  return `${floor_m} to ${ceiling_m} m ${ABOVE[reference]}`;
}
