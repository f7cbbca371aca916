// Tool of the map that measures a distance. Escape ends it.

/**
 * @import { Point } from "../page_types.d.ts"
 * @import { Colour, Context } from "./canvas.js"
 * @import { View } from "./map_view.js"
 */

import { addLine } from "./canvas.js";
import { metres } from "./format.js";
import { distance } from "./geometry.js";

export class Measure {
  constructor() {
    this.hint = "Click two points. Esc ends.";
    /** @type {Point | null} */
    this.from = null;
    /** @type {Point | null} */
    this.to = null;
    this.isMeasured = true;
  }

  /** @param {Point} place */
  click(place) {
    if (this.isMeasured) this.from = place;
    this.to = place;
    this.isMeasured = !this.isMeasured;
  }

  /** @param {Point} place */
  hover(place) {
    if (!this.isMeasured) this.to = place;
  }

  /**
   * @param {Context} ctx
   * @param {View} view
   * @param {Colour} colour
   */
  draw(ctx, view, colour) {
    if (!this.from || !this.to) return;
    ctx.strokeStyle = colour("advisory");
    ctx.lineWidth = 2;
    ctx.beginPath();
    addLine(ctx, view, [this.from, this.to]);
    ctx.stroke();
    ctx.fillStyle = colour("text");
    ctx.textAlign = "left";
    ctx.fillText(lengthAndBearing(this.from, this.to), view.x(this.to[0]) + 12, view.y(this.to[1]) - 8);
  }
}

/**
 * @param {Point} from
 * @param {Point} to
 */
export function lengthAndBearing(from, to) {
  const bearing = ((Math.atan2(to[0] - from[0], to[1] - from[1]) * 180) / Math.PI + 360) % 360;
  return `${metres(distance(from, to))}  ${bearing.toFixed(0)}°`;
}
