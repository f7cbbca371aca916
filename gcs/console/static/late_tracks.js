// Late estimates: where each track was, as known some scans later. A gap is null.

/**
 * @import { LatePath } from "../page_types.d.ts"
 * @import { Colour, Context } from "./canvas.js"
 * @import { View } from "./map_view.js"
 */

import { addLine, beginDisc } from "./canvas.js";

const MAX_TRACKS = 200; // of more, those that ended first are forgotten
const MAX_POINTS = 400;
const DOT_PX = 2;

export class LateTracks {
  constructor() {
    /** @type {Map<string, LatePath>} */
    this.paths = new Map();
  }

  /**
   * Begin with what was before this page.
   *
   * @param {Record<string, LatePath>} paths
   */
  begin(paths) {
    this.paths = new Map();
    this.add(paths);
  }

  /** @param {Record<string, LatePath>} paths new points of each track */
  add(paths) {
    for (const [name, points] of Object.entries(paths)) {
      const path = [...(this.paths.get(name) ?? []), ...points];
      this.paths.delete(name); // so that the track that was estimated last is the last one
      this.paths.set(name, path.slice(-MAX_POINTS));
    }
    for (const name of this.paths.keys()) {
      if (this.paths.size <= MAX_TRACKS) break;
      this.paths.delete(name);
    }
  }

  /**
   * Draw a line through the estimates of each track, with a dot at the last one.
   *
   * @param {Context} ctx
   * @param {View} view
   * @param {Colour} colour
   */
  draw(ctx, view, colour) {
    ctx.lineWidth = 2;
    for (const [name, path] of this.paths) {
      ctx.strokeStyle = ctx.fillStyle = colour(name.startsWith("A") ? "vehicle" : "target");
      ctx.setLineDash([1, 3]);
      ctx.beginPath();
      addLine(ctx, view, path);
      ctx.stroke();
      ctx.setLineDash([]);
      const last = path.at(-1);
      if (!last) continue;
      beginDisc(ctx, view, [...last, DOT_PX / view.scale]);
      ctx.fill();
    }
  }
}
