// Tool of the map that changes the shape of a no-fly zone by its handles. Nothing is sent before "Send".

/**
 * @import { NoFlyZone, Point } from "../page_types.d.ts"
 * @import { Colour, Context, Disc } from "./canvas.js"
 * @import { View } from "./map_view.js"
 * @import { Shape } from "./zone_draw_tools.js"
 */

import { beginDisc, beginRing } from "./canvas.js";
import { centroid, distance, whole } from "./geometry.js";

const HANDLE_PX = 6;
const HIT_PX = 16;
const MIN_RADIUS_M = 5;

export class ZoneEdit {
  /**
   * @param {NoFlyZone} zone
   * @param {(shape: Shape) => void} done
   * @param {(shape: Shape) => void} ask for its numbers and heights
   * @param {() => void} cancel
   */
  constructor(zone, done, ask, cancel) {
    this.hint = `Drag the handles of ${zone.name}.`;
    /** @type {Disc | null} */
    this.disc = zone.disc_m;
    /** @type {Point[]} */
    this.corners = zone.polygon_m;
    /** @type {number | null} */
    this.grabbed = null;
    this.scale = 1; // pixels per metre
    /** @type {[string, () => void][]} */
    this.actions = [
      ["Send", () => done(this.shape())],
      ["Heights", () => ask(this.shape())],
      ["Cancel", cancel],
    ];
  }

  /** @returns {Shape} */
  shape() {
    if (!this.disc) return { polygon: this.corners.map(whole) };
    const [east, north, radius] = this.disc;
    return { circle: [...whole([east, north]), Math.round(radius)] };
  }

  /**
   * Return the handles. The first moves the whole zone; that of a circle's edge sets its radius.
   *
   * @returns {Point[]}
   */
  handles() {
    if (!this.disc) return [centroid(this.corners), ...this.corners];
    const [east, north, radius] = this.disc;
    return [
      [east, north],
      [east + radius, north],
    ];
  }

  /**
   * Grab the nearest handle; return false if none is near.
   *
   * @param {Point} place
   */
  down(place) {
    const distances = this.handles().map((handle) => distance(handle, place) * this.scale);
    const nearest = Math.min(...distances);
    this.grabbed = nearest < HIT_PX ? distances.indexOf(nearest) : null;
    return this.grabbed !== null;
  }

  /** @param {Point} place */
  drag(place) {
    if (this.grabbed === null) return;
    const [middle] = this.handles();
    if (this.grabbed === 0) this.shift(place[0] - middle[0], place[1] - middle[1]);
    else if (this.disc) this.disc = [...middle, Math.max(MIN_RADIUS_M, distance(place, middle))];
    else this.corners = this.corners.map((corner, index) => (index + 1 === this.grabbed ? place : corner));
  }

  /**
   * @param {number} east
   * @param {number} north
   */
  shift(east, north) {
    if (this.disc) this.disc = [this.disc[0] + east, this.disc[1] + north, this.disc[2]];
    this.corners = this.corners.map((corner) => [corner[0] + east, corner[1] + north]);
  }

  up() {
    this.grabbed = null;
  }

  /**
   * @param {Context} ctx
   * @param {View} view
   * @param {Colour} colour
   */
  draw(ctx, view, colour) {
    this.scale = view.scale;
    ctx.strokeStyle = ctx.fillStyle = colour("advisory");
    ctx.lineWidth = 2;
    if (this.disc) beginDisc(ctx, view, this.disc);
    else beginRing(ctx, view, this.corners);
    ctx.stroke();
    for (const [east, north] of this.handles())
      ctx.fillRect(view.x(east) - HANDLE_PX, view.y(north) - HANDLE_PX, 2 * HANDLE_PX, 2 * HANDLE_PX);
  }
}
