// Map tiles of the service's MBTiles file, placed by the corners of each tile in the local frame.

/**
 * @import { MissionInfo } from "../page_types.d.ts"
 * @import { Context } from "./canvas.js"
 * @import { View } from "./map_view.js"
 */

import { latOf, lonOf, METRES_PER_DEGREE, radians, tileColumn, tileRow, toLocal } from "./geodesy.js";

const TILE_PX = 256;
const MAX_TILES = 80; // of one picture
const MAX_KEPT = 300;
const MAX_LAT = 85;

export class Tiles {
  /** @param {() => void} redraw */
  constructor(redraw) {
    this.redraw = redraw;
    /** @type {Map<string, HTMLImageElement>} */
    this.images = new Map();
  }

  /**
   * @param {Context} ctx
   * @param {View} view
   * @param {{ min_zoom: number, max_zoom: number }} tiles
   * @param {MissionInfo} mission
   */
  draw(ctx, view, tiles, mission) {
    const [lat0, lon0] = mission.origin_deg;
    const metresPerLon = METRES_PER_DEGREE * Math.cos(radians(lat0));
    const [west, top] = view.place(0, 0);
    const [east, bottom] = view.place(view.width, view.height);
    const [north, south] = [top, bottom].map((metres) => lat0 + metres / METRES_PER_DEGREE);
    if (north > MAX_LAT || south < -MAX_LAT) return;
    const zoom = Math.min(
      tiles.max_zoom,
      Math.max(tiles.min_zoom, Math.round(Math.log2((360 * metresPerLon * view.scale) / TILE_PX))),
    );
    const [firstColumn, lastColumn] = [west, east].map((metres) =>
      Math.floor(tileColumn(lon0 + metres / metresPerLon, zoom)),
    );
    const [firstRow, lastRow] = [north, south].map((lat) => Math.floor(tileRow(lat, zoom)));
    if ((lastColumn - firstColumn + 1) * (lastRow - firstRow + 1) > MAX_TILES) return;
    ctx.imageSmoothingEnabled = true;
    for (let row = firstRow; row <= lastRow; row++) {
      for (let column = firstColumn; column <= lastColumn; column++)
        this.drawTile(ctx, view, mission, zoom, column, row);
    }
  }

  /**
   * @param {Context} ctx
   * @param {View} view
   * @param {MissionInfo} mission
   * @param {number} zoom
   * @param {number} column
   * @param {number} row
   */
  drawTile(ctx, view, mission, zoom, column, row) {
    const image = this.image(`${zoom}/${column}/${row}`);
    if (!image.complete || !image.naturalWidth) return;
    const [west, north] = toLocal(mission, latOf(row, zoom), lonOf(column, zoom));
    const [east, south] = toLocal(mission, latOf(row + 1, zoom), lonOf(column + 1, zoom));
    const [x, y] = [Math.floor(view.x(west)), Math.floor(view.y(north))];
    ctx.drawImage(image, x, y, Math.ceil(view.x(east)) - x, Math.ceil(view.y(south)) - y);
  }

  /** @param {string} name */
  image(name) {
    const known = this.images.get(name);
    if (known) return known;
    const image = new Image();
    image.onload = this.redraw;
    image.src = `tiles/${name}`;
    this.images.set(name, image);
    if (this.images.size > MAX_KEPT) {
      const [oldest] = this.images.keys();
      this.images.delete(oldest);
    }
    return image;
  }
}
