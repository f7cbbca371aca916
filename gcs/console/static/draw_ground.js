// Drawing of what stands: grid lines, obstacles, no-fly zones, fence, homes, rally points, fields of view.

/**
 * @import { FieldOfView, MissionInfo, NoFlyZone, ObstacleMap, Polar } from "../page_types.d.ts"
 * @import { Colour, Context } from "./canvas.js"
 * @import { View } from "./map_view.js"
 */

import { beginDisc, beginRing, strokeLine } from "./canvas.js";
import { limitsText, metres, shortened } from "./format.js";
import { centroid, roundLength } from "./geometry.js";

const GRID_PX = 90;
const SCALE_PX = 60;
const BELOW_ALPHA = 0.4; // of obstacles that vehicles in their layers fly over
const MAX_NAME = 24; // characters of a zone's name on the map

/**
 * @param {Context} ctx
 * @param {View} view
 * @param {Colour} colour
 */
export function drawGridLines(ctx, view, colour) {
  const step = roundLength(GRID_PX / view.scale);
  const [west, north] = view.place(0, 0);
  const [east, south] = view.place(view.width, view.height);
  ctx.strokeStyle = colour("map-line");
  ctx.lineWidth = 1;
  ctx.beginPath();
  for (let at = Math.ceil(west / step) * step; at < east; at += step) {
    const x = Math.round(view.x(at)) + 0.5;
    ctx.moveTo(x, 0);
    ctx.lineTo(x, view.height);
  }
  for (let at = Math.ceil(south / step) * step; at < north; at += step) {
    const y = Math.round(view.y(at)) + 0.5;
    ctx.moveTo(0, y);
    ctx.lineTo(view.width, y);
  }
  ctx.stroke();
}

/** Obstacle cells as a small image with one pixel for each cell. */
export class Obstacles {
  constructor() {
    /** @type {OffscreenCanvas | null} */
    this.image = null;
    /** @type {ObstacleMap | null} */
    this.map = null;
  }

  /**
   * @param {ObstacleMap} map
   * @param {Colour} colour
   */
  set(map, colour) {
    const [rows, columns] = map.shape;
    const image = new OffscreenCanvas(columns, rows);
    const ctx = image.getContext("2d");
    if (!ctx) return;
    ctx.fillStyle = colour("obstacle");
    for (const [cells, alpha] of /** @type {const} */ ([
      [map.blocked, 1],
      [map.below, BELOW_ALPHA],
    ])) {
      const bits = Uint8Array.from(atob(cells), (one) => one.charCodeAt(0));
      ctx.globalAlpha = alpha;
      for (let index = 0; index < 8 * bits.length; index++) {
        if (bits[index >> 3] & (1 << (index & 7)))
          ctx.fillRect(index % columns, rows - 1 - Math.floor(index / columns), 1, 1);
      }
    }
    this.image = image;
    this.map = map;
  }

  /** @param {Colour} colour */
  recolour(colour) {
    if (this.map) this.set(this.map, colour);
  }

  /**
   * @param {Context} ctx
   * @param {View} view
   */
  draw(ctx, view) {
    if (!this.image || !this.map) return;
    const [east, north] = this.map.origin_m;
    const [rows, columns] = this.map.shape;
    const cell = this.map.spacing_m;
    ctx.imageSmoothingEnabled = false;
    ctx.drawImage(
      this.image,
      view.x(east - cell / 2),
      view.y(north + (rows - 0.5) * cell),
      columns * cell * view.scale,
      rows * cell * view.scale,
    );
  }
}

/**
 * @param {Context} ctx
 * @param {View} view
 * @param {MissionInfo} mission
 * @param {Colour} colour
 */
export function drawBorder(ctx, view, mission, colour) {
  const [width, height] = mission.size_m;
  beginRing(ctx, view, [
    [0, 0],
    [width, 0],
    [width, height],
    [0, height],
  ]);
  ctx.strokeStyle = colour("line");
  ctx.lineWidth = 1;
  ctx.stroke();
}

/**
 * @param {Context} ctx
 * @param {View} view
 * @param {MissionInfo} mission
 * @param {Colour} colour
 */
export function drawFence(ctx, view, mission, colour) {
  ctx.lineWidth = 1.5;
  ctx.setLineDash([10, 4]);
  for (const area of mission.fence) {
    beginRing(ctx, view, area.ring);
    ctx.strokeStyle = colour(area.stay_in ? "done" : "warning");
    ctx.stroke();
  }
  ctx.setLineDash([]);
}

/**
 * @param {Context} ctx
 * @param {View} view
 * @param {NoFlyZone[]} zones
 * @param {Colour} colour
 */
export function drawZones(ctx, view, zones, colour) {
  ctx.fillStyle = ctx.strokeStyle = colour("warning");
  ctx.lineWidth = 1.5;
  ctx.textAlign = "center";
  for (const zone of zones) {
    if (zone.disc_m) beginDisc(ctx, view, zone.disc_m);
    else beginRing(ctx, view, zone.polygon_m);
    ctx.globalAlpha = 0.16;
    ctx.fill();
    ctx.globalAlpha = 1;
    ctx.stroke();
    const [east, north] = zone.disc_m ?? centroid(zone.polygon_m);
    ctx.fillText(shortened(zone.name, MAX_NAME), view.x(east), view.y(north) + 4);
    ctx.fillText(limitsText(zone.limits), view.x(east), view.y(north) + 18);
  }
}

/**
 * @param {Context} ctx
 * @param {View} view
 * @param {MissionInfo} mission
 * @param {Colour} colour
 */
export function drawHomes(ctx, view, mission, colour) {
  ctx.strokeStyle = ctx.fillStyle = colour("dim");
  ctx.lineWidth = 1.2;
  for (const at of mission.homes) {
    const [x, y] = [view.x(at[0]), view.y(at[1])];
    ctx.beginPath();
    ctx.moveTo(x - 5, y);
    ctx.lineTo(x, y - 5);
    ctx.lineTo(x + 5, y);
    ctx.moveTo(x - 3.5, y);
    ctx.lineTo(x - 3.5, y + 4);
    ctx.lineTo(x + 3.5, y + 4);
    ctx.lineTo(x + 3.5, y);
    ctx.stroke();
  }
  ctx.textAlign = "center";
  for (const at of mission.rally) ctx.fillText("R", view.x(at[0]), view.y(at[1]) + 4);
}

/**
 * @param {Context} ctx
 * @param {View} view
 * @param {FieldOfView[]} fields
 * @param {Colour} colour
 */
export function drawFieldsOfView(ctx, view, fields, colour) {
  ctx.strokeStyle = colour("detection");
  ctx.globalAlpha = 0.5;
  ctx.lineWidth = 1;
  for (const field of fields) {
    if (field.polar) {
      beginSector(ctx, view, field.polar);
    } else {
      const [west, south, east, north] = field.box_m;
      beginRing(ctx, view, [
        [west, south],
        [east, south],
        [east, north],
        [west, north],
      ]);
    }
    ctx.stroke();
  }
  ctx.globalAlpha = 1;
}

/**
 * @param {Context} ctx
 * @param {View} view
 * @param {Polar} sector
 */
function beginSector(
  ctx,
  view,
  { east_m: east, north_m: north, range_m: [near, far], bearing_rad: [centre, half] },
) {
  const [x, y] = [view.x(east), view.y(north)];
  const middle = centre - Math.PI / 2; // bearings are clockwise from north, canvas angles clockwise from east
  ctx.beginPath();
  ctx.arc(x, y, far * view.scale, middle - half, middle + half);
  if (half < Math.PI) ctx.arc(x, y, near * view.scale, middle + half, middle - half, true);
  ctx.closePath();
}

/**
 * Draw the bar that shows a round length.
 *
 * @param {Context} ctx
 * @param {View} view
 * @param {Colour} colour
 * @param {string} note beside it
 */
export function drawScaleBar(ctx, view, colour, note) {
  const length = roundLength(SCALE_PX / view.scale);
  const [x, y] = [12, view.height - 12];
  const end = x + length * view.scale;
  ctx.strokeStyle = ctx.fillStyle = colour("dim");
  ctx.lineWidth = 1.5;
  strokeLine(ctx, [
    [x, y - 5],
    [x, y],
    [end, y],
    [end, y - 5],
  ]);
  ctx.textAlign = "left";
  ctx.fillText(metres(length), x + 4, y - 5);
  ctx.fillText(note, end + 12, y);
}
