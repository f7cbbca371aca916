// Numbers as operators read them.

export const FIXES = ["none", "none", "2D", "3D", "DGPS", "float", "RTK", "static"];

// From this many vehicles on, rows are low.
export const DENSE_ROWS = 24;

export function number(value, digits = 0, unit = "") {
  return value === null || value === undefined ? "–" : value.toFixed(digits) + unit;
}

export function seconds(value) {
  if (value === null || value === undefined) return "–";
  return value < 100 ? `${value.toFixed(1)} s` : duration(value);
}

export function duration(value) {
  if (value === null || value === undefined) return "–";
  const whole = Math.max(0, Math.round(value));
  const hours = Math.floor(whole / 3600);
  const minutes = Math.floor(whole / 60) % 60;
  const pad = (part) => String(part).padStart(2, "0");
  return hours ? `${hours}:${pad(minutes)}:${pad(whole % 60)}` : `${minutes}:${pad(whole % 60)}`;
}

export function metres(value) {
  if (value === null || value === undefined) return "–";
  return Math.abs(value) < 10000 ? `${value.toFixed(0)} m` : `${(value / 1000).toFixed(1)} km`;
}

export function megabytes(value) {
  if (value === null || value === undefined) return "–";
  return value < 1000
    ? `${value.toFixed(value < 10 ? 1 : 0)} MB`
    : `${(value / 1000).toFixed(value < 10000 ? 1 : 0)} GB`;
}
