// Tools of the map that draw a no-fly zone: disc and polygon. Escape ends a tool.

/**
 * @import { Point } from "../page_types.d.ts"
 * @import { Colour, Context, Disc } from "./canvas.js"
 * @import { View } from "./map_view.js"
 *
 * @typedef {{ circle: Disc, polygon?: undefined } | { circle?: undefined, polygon: Point[] }} Shape
 *   of a zone, as an order has it, in whole metres
 */

import { addLine, beginDisc } from "./canvas.js";
import { distance, whole } from "./geometry.js";

const CLOSING_PX = 14;

export class CircleTool {
  /** @param {(shape: Shape) => void} done */
  constructor(done) {
    this.hint = "Press at the centre and drag to the edge. Esc ends.";
    this.done = done;
    /** @type {Point | null} */
    this.centre = null;
    this.radius = 0;
  }

  /** @param {Point} place */
  down(place) {
    this.centre = place;
    this.radius = 0;
    return true;
  }

  /** @param {Point} place */
  drag(place) {
    if (this.centre) this.radius = distance(place, this.centre);
  }

  up() {
    if (this.centre && this.radius > 1)
      this.done({ circle: [...whole(this.centre), Math.round(this.radius)] });
  }

  /**
   * @param {Context} ctx
   * @param {View} view
   * @param {Colour} colour
   */
  draw(ctx, view, colour) {
    if (!this.centre) return;
    ctx.strokeStyle = colour("warning");
    ctx.lineWidth = 2;
    beginDisc(ctx, view, [...this.centre, this.radius]);
    ctx.stroke();
  }
}

export class PolygonTool {
  /** @param {(shape: Shape) => void} done */
  constructor(done) {
    this.hint = "Click the corners; click the first one again to close. Esc ends.";
    this.done = done;
    /** @type {Point[]} */
    this.points = [];
    /** @type {Point | null} */
    this.pointer = null;
    this.scale = 1; // pixels per metre
  }

  /** @param {Point} place */
  click(place) {
    const isClosing = this.points.length > 2 && distance(place, this.points[0]) * this.scale < CLOSING_PX;
    if (isClosing) this.done({ polygon: this.points.map(whole) });
    else this.points.push(place);
  }

  /** @param {Point} place */
  hover(place) {
    this.pointer = place;
  }

  /**
   * @param {Context} ctx
   * @param {View} view
   * @param {Colour} colour
   */
  draw(ctx, view, colour) {
    this.scale = view.scale;
    if (!this.points.length) return;
    ctx.strokeStyle = colour("warning");
    ctx.lineWidth = 2;
    ctx.beginPath();
    addLine(ctx, view, [...this.points, this.pointer]);
    ctx.stroke();
  }
}
