// Ground of a mission over terrain: its heights, and its picture of hill shading and contours on the map.

/**
 * @import { ElevationMap, Point } from "../page_types.d.ts"
 * @import { Colour, Context } from "./canvas.js"
 * @import { View } from "./map_view.js"
 *
 * @typedef {[red: number, green: number, blue: number]} Rgb
 */

import { roundLength } from "./geometry.js";

const CONTOURS = 20; // at most, from the lowest to the highest
const THICK_EVERY = 5;
const LIGHT = [-0.5, 0.5, Math.SQRT1_2]; // from the north-west, 45° above the horizon
const FLAT = LIGHT[2];
const MIN_BRIGHTNESS = 0.35;

/** Heights of the ground, bilinear between nodes. */
export class Ground {
  /** @param {ElevationMap} map */
  constructor({ origin_m: origin, spacing_m: spacing, shape, lowest_msl_m: lowest, step_m: step, heights }) {
    this.origin = origin;
    this.spacing = spacing;
    this.rows = shape[0];
    this.columns = shape[1];
    const bytes = Uint8Array.from(atob(heights), (one) => one.charCodeAt(0));
    const data = new DataView(bytes.buffer);
    this.heights = Float32Array.from(
      { length: this.rows * this.columns },
      (_, index) => lowest + step * data.getUint16(2 * index, true),
    );
    let highest = lowest;
    for (const height of this.heights) highest = Math.max(highest, height);
    this.lowest = lowest;
    this.highest = highest;
  }

  /**
   * Return the height above mean sea level of a node.
   *
   * @param {number} row
   * @param {number} column
   */
  node(row, column) {
    return this.heights[row * this.columns + column];
  }

  /**
   * Return the height above mean sea level at a place; null beyond the nodes.
   *
   * @param {Point} place
   */
  at([east, north]) {
    const x = (east - this.origin[0]) / this.spacing;
    const y = (north - this.origin[1]) / this.spacing;
    if (!(x >= 0 && y >= 0 && x <= this.columns - 1 && y <= this.rows - 1)) return null;
    const column = Math.min(Math.floor(x), this.columns - 2);
    const row = Math.min(Math.floor(y), this.rows - 2);
    const [along, up] = [x - column, y - row];
    const south = (1 - along) * this.node(row, column) + along * this.node(row, column + 1);
    const north_ = (1 - along) * this.node(row + 1, column) + along * this.node(row + 1, column + 1);
    return (1 - up) * south + up * north_;
  }

  /** Height from one contour to the next. */
  get interval() {
    return roundLength(Math.max(1, (this.highest - this.lowest) / CONTOURS));
  }

  /**
   * Return how bright the sun makes a node: 1 for level ground, less on slopes to the south-east.
   *
   * @param {number} row
   * @param {number} column
   */
  brightness(row, column) {
    const [west, east] = [Math.max(0, column - 1), Math.min(this.columns - 1, column + 1)];
    const [south, north] = [Math.max(0, row - 1), Math.min(this.rows - 1, row + 1)];
    const eastward = (this.node(row, east) - this.node(row, west)) / ((east - west) * this.spacing);
    const northward =
      (this.node(north, column) - this.node(south, column)) / ((north - south) * this.spacing);
    const toLight = LIGHT[2] - LIGHT[0] * eastward - LIGHT[1] * northward;
    return Math.max(MIN_BRIGHTNESS, toLight / Math.hypot(1, eastward, northward) / FLAT);
  }

  /**
   * Call back with each line of a contour through a cell, in columns and rows.
   *
   * @param {number} level
   * @param {(x0: number, y0: number, x1: number, y1: number) => void} line
   */
  contour(level, line) {
    for (let row = 0; row < this.rows - 1; row++) {
      for (let column = 0; column < this.columns - 1; column++) {
        const ends = this.crossings(row, column, level);
        for (let k = 0; k + 1 < ends.length; k += 2) line(...ends[k], ...ends[k + 1]);
      }
    }
  }

  /**
   * Return where a level crosses the sides of a cell.
   *
   * @param {number} row
   * @param {number} column
   * @param {number} level
   */
  crossings(row, column, level) {
    const [a, b] = [this.node(row, column) - level, this.node(row, column + 1) - level];
    const [d, c] = [this.node(row + 1, column) - level, this.node(row + 1, column + 1) - level];
    /** @type {Point[]} */
    const ends = [];
    if (a < 0 === b < 0 && b < 0 === c < 0 && c < 0 === d < 0) return ends;
    if (a < 0 !== b < 0) ends.push([column + a / (a - b), row]);
    if (b < 0 !== c < 0) ends.push([column + 1, row + b / (b - c)]);
    if (c < 0 !== d < 0) ends.push([column + d / (d - c), row + 1]);
    if (d < 0 !== a < 0) ends.push([column, row + a / (a - d)]);
    return ends;
  }
}

/** Hill shading with one pixel for each node, and contours as paths: made once, drawn with every frame. */
export class TerrainPicture {
  constructor() {
    /** @type {Ground | null} */
    this.ground = null;
    this.heights = "";
    /** @type {OffscreenCanvas | null} */
    this.image = null;
    this.thin = new Path2D();
    this.thick = new Path2D();
  }

  /**
   * @param {ElevationMap | null} map
   * @param {Colour} colour
   */
  set(map, colour) {
    if ((map?.heights ?? "") === this.heights) return;
    this.heights = map?.heights ?? "";
    this.ground = map && new Ground(map);
    this.traceContours();
    this.recolour(colour);
  }

  traceContours() {
    this.thin = new Path2D();
    this.thick = new Path2D();
    if (!this.ground) return;
    const { interval, highest, lowest } = this.ground;
    for (let count = Math.ceil(lowest / interval); count * interval < highest; count++) {
      const path = count % THICK_EVERY ? this.thin : this.thick;
      this.ground.contour(count * interval, (x0, y0, x1, y1) => {
        path.moveTo(x0, y0);
        path.lineTo(x1, y1);
      });
    }
  }

  /** @param {Colour} colour */
  recolour(colour) {
    const { ground } = this;
    this.image = ground && new OffscreenCanvas(ground.columns, ground.rows);
    const ctx = this.image?.getContext("2d");
    if (!ground || !ctx) return;
    const [low, high] = [rgbOf(colour("terrain-low")), rgbOf(colour("terrain-high"))];
    const shading = Number(colour("terrain-shading"));
    const pixels = ctx.createImageData(ground.columns, ground.rows);
    const range = Math.max(1, ground.highest - ground.lowest);
    for (let row = 0; row < ground.rows; row++) {
      for (let column = 0; column < ground.columns; column++) {
        const share = (ground.node(row, column) - ground.lowest) / range;
        const bright = 1 + shading * (ground.brightness(row, column) - 1);
        const at = 4 * ((ground.rows - 1 - row) * ground.columns + column);
        for (let k = 0; k < 3; k++) pixels.data[at + k] = bright * (low[k] + share * (high[k] - low[k]));
        pixels.data[at + 3] = 255;
      }
    }
    ctx.putImageData(pixels, 0, 0);
  }

  /**
   * @param {Context} ctx
   * @param {View} view
   * @param {Colour} colour
   */
  draw(ctx, view, colour) {
    if (!this.image || !this.ground) return;
    const { origin, spacing, rows } = this.ground;
    const cell = spacing * view.scale;
    ctx.save();
    ctx.translate(view.x(origin[0]), view.y(origin[1]));
    ctx.scale(cell, -cell);
    ctx.save();
    ctx.scale(1, -1);
    ctx.imageSmoothingEnabled = true;
    ctx.drawImage(this.image, -0.5, 0.5 - rows);
    ctx.restore();
    ctx.strokeStyle = colour("contour");
    ctx.lineWidth = 0.8 / cell;
    ctx.stroke(this.thin);
    ctx.lineWidth = 1.6 / cell;
    ctx.stroke(this.thick);
    ctx.restore();
  }

  /** What the contours are, in words; empty if the ground is flat. */
  get legend() {
    return this.ground ? `contours every ${this.ground.interval} m` : "";
  }
}

/**
 * @param {string} colour as #rrggbb
 * @returns {Rgb}
 */
function rgbOf(colour) {
  const value = Number.parseInt(colour.slice(1), 16);
  return [value >> 16, (value >> 8) & 255, value & 255];
}
