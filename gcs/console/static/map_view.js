// View of the map: east/north metres to pixels and back. North is up.

/** @import { Point } from "../page_types.d.ts" */

const MIN_SCALE = 0.005; // pixels per metre
const MAX_SCALE = 20;
const MIN_EXTENT_M = 100;

/** @param {number} scale */
const bounded = (scale) => Math.min(MAX_SCALE, Math.max(MIN_SCALE, scale));

export class View {
  constructor() {
    this.east = 0;
    this.north = 0;
    this.scale = 0.1;
    this.width = 1;
    this.height = 1;
  }

  /** @param {number} east */
  x(east) {
    return this.width / 2 + (east - this.east) * this.scale;
  }

  /** @param {number} north */
  y(north) {
    return this.height / 2 - (north - this.north) * this.scale;
  }

  /**
   * Return the point at a pixel.
   *
   * @param {number} x
   * @param {number} y
   * @returns {Point}
   */
  place(x, y) {
    return [this.east + (x - this.width / 2) / this.scale, this.north - (y - this.height / 2) / this.scale];
  }

  /** @param {Point} point */
  shows([east, north]) {
    const [x, y] = [this.x(east), this.y(north)];
    return x >= 0 && y >= 0 && x <= this.width && y <= this.height;
  }

  /**
   * @param {number} dx
   * @param {number} dy
   */
  pan(dx, dy) {
    this.east -= dx / this.scale;
    this.north += dy / this.scale;
  }

  /**
   * Zoom; the point at a pixel stays there.
   *
   * @param {number} factor
   * @param {number} x
   * @param {number} y
   */
  zoom(factor, x = this.width / 2, y = this.height / 2) {
    const [east, north] = this.place(x, y);
    this.scale = bounded(this.scale * factor);
    const [eastNow, northNow] = this.place(x, y);
    this.east += east - eastNow;
    this.north += north - northNow;
  }

  /**
   * Show all points.
   *
   * @param {Point[]} points
   * @param {number} margin in pixels
   */
  fit(points, margin = 40) {
    if (!points.length) return;
    const easts = points.map((point) => point[0]);
    const norths = points.map((point) => point[1]);
    const west = Math.min(...easts);
    const east = Math.max(...easts);
    const south = Math.min(...norths);
    const north = Math.max(...norths);
    this.east = (west + east) / 2;
    this.north = (south + north) / 2;
    const across = Math.max(1, this.width - 2 * margin) / Math.max(east - west, MIN_EXTENT_M);
    const up = Math.max(1, this.height - 2 * margin) / Math.max(north - south, MIN_EXTENT_M);
    this.scale = bounded(Math.min(across, up));
  }
}
