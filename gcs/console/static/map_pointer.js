// Pointer on the map: drag, wheel, pinch, click, selection box; a tool of the map comes first.

/**
 * @import { Point } from "../page_types.d.ts"
 * @import { Colour, Context } from "./canvas.js"
 * @import { Feed } from "./feed.js"
 * @import { SwarmMap } from "./map.js"
 * @import { Selection } from "./selection.js"
 *
 * @typedef {[x0: number, y0: number, x1: number, y1: number]} Box
 * @typedef {{ x: number, y: number, moved: boolean, boxes: boolean }} Press
 */

import { setText } from "./dom.js";
import { targetName } from "./format.js";

const CLICK_PX = 5;
const HIT_PX = 18;
const ZOOM_PER_PX = 0.0015;

export class Pointer {
  /**
   * @param {SwarmMap} map
   * @param {HTMLElement} place where the coordinates are written
   * @param {Feed} feed
   * @param {Selection} selection
   */
  constructor(map, place, feed, selection) {
    this.map = map;
    this.place = place;
    this.feed = feed;
    this.selection = selection;
    /** @type {Map<number, PointerEvent>} */
    this.pressed = new Map(); // by pointer, of fingers too
    /** @type {Press | null} */
    this.press = null;
    /** @type {Box | null} */
    this.box = null;
    this.isDrawing = false; // a tool has the pointer until it is released
    const { canvas } = map;
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerup", (event) => this.up(event));
    canvas.addEventListener("pointercancel", (event) => this.up(event));
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
  }

  /** @param {MouseEvent} event */
  pointOf(event) {
    return this.map.view.place(event.offsetX, event.offsetY);
  }

  /** @param {PointerEvent} event */
  down(event) {
    const { canvas, tool } = this.map;
    canvas.setPointerCapture(event.pointerId);
    this.pressed.set(event.pointerId, event);
    this.press = { x: event.offsetX, y: event.offsetY, moved: false, boxes: event.shiftKey && !tool };
    this.isDrawing = this.pressed.size === 1 && (tool?.down?.(this.pointOf(event)) ?? false);
  }

  /** @param {PointerEvent} event */
  move(event) {
    const { map, press } = this;
    const [east, north] = this.pointOf(event);
    const ground = map.picture.terrain.ground?.at([east, north]) ?? null;
    const height = ground === null ? "" : `  ground ${ground.toFixed(0)} m`;
    setText(this.place, `E ${east.toFixed(0)}  N ${north.toFixed(0)}${height}`);
    const before = this.pressed.get(event.pointerId);
    if (before && press) this.drag(event, before, press);
    else if (map.tool) map.tool.hover?.([east, north]);
    else return;
    map.redraw();
  }

  /**
   * @param {PointerEvent} event
   * @param {PointerEvent} before
   * @param {Press} press
   */
  drag(event, before, press) {
    const { motion, tool } = this.map;
    const other = [...this.pressed.values()].find((one) => one.pointerId !== event.pointerId);
    this.pressed.set(event.pointerId, event);
    if (Math.hypot(event.offsetX - press.x, event.offsetY - press.y) > CLICK_PX) press.moved = true;
    if (other) this.pinch(other, before, event);
    else if (this.isDrawing) tool?.drag?.(this.pointOf(event));
    else if (press.boxes) this.box = [press.x, press.y, event.offsetX, event.offsetY];
    else if (press.moved) motion.pan(event.offsetX - before.offsetX, event.offsetY - before.offsetY);
  }

  /** @param {PointerEvent} event */
  up(event) {
    const { map, press } = this;
    this.pressed.delete(event.pointerId);
    if (!press) return;
    const isClick = !press.moved && event.type === "pointerup";
    if (this.box) this.selectBox(this.box);
    else if (this.isDrawing) map.tool?.up?.();
    else if (isClick && map.tool) map.tool.click?.(this.pointOf(event));
    else if (isClick) this.selectAt(event);
    this.press = null;
    this.box = null;
    this.isDrawing = false;
    map.redraw();
  }

  /** @param {WheelEvent} event */
  wheel(event) {
    event.preventDefault();
    this.map.motion.zoom(Math.exp(-ZOOM_PER_PX * event.deltaY), event.offsetX, event.offsetY);
  }

  /**
   * @param {PointerEvent} other
   * @param {PointerEvent} before
   * @param {PointerEvent} now
   */
  pinch(other, before, now) {
    /** @param {PointerEvent} event */
    const apart = (event) => Math.hypot(event.offsetX - other.offsetX, event.offsetY - other.offsetY);
    const factor = apart(now) / Math.max(1, apart(before));
    this.map.motion.zoom(factor, (now.offsetX + other.offsetX) / 2, (now.offsetY + other.offsetY) / 2);
  }

  /** Return the vehicles that are drawn, with their places in pixels. */
  drawnVehicles() {
    return this.feed.data.vehicles.flatMap(({ vehicle: id, position_m: at, status }) =>
      at && status !== "lost" ? [{ id, ...this.pixelOf(at) }] : [],
    );
  }

  drawnTargets() {
    return this.feed.data.targets.map(({ label, position_m: at }) => ({
      name: targetName(label),
      ...this.pixelOf(at),
    }));
  }

  /** @param {Point} at */
  pixelOf(at) {
    return { x: this.map.view.x(at[0]), y: this.map.view.y(at[1]) };
  }

  /**
   * Select what is at the pointer; where both are, a vehicle comes before a target.
   *
   * @param {PointerEvent} event
   */
  selectAt(event) {
    const vehicle = nearest(this.drawnVehicles(), event);
    const target = nearest(this.drawnTargets(), event);
    if (vehicle) this.selection.toggle(vehicle.id, event);
    else if (target) this.selection.toggleTarget(target.name);
    else this.selection.clear();
  }

  /** @param {Box} box */
  selectBox([x0, y0, x1, y1]) {
    const within = this.drawnVehicles().filter(({ x, y }) => isBetween(x, x0, x1) && isBetween(y, y0, y1));
    this.selection.set(within.map(({ id }) => id));
  }

  /**
   * Draw the box that is being drawn.
   *
   * @param {Context} ctx
   * @param {Colour} colour
   */
  drawBox(ctx, colour) {
    if (!this.box) return;
    const [x0, y0, x1, y1] = this.box;
    ctx.strokeStyle = colour("advisory");
    ctx.lineWidth = 1;
    ctx.strokeRect(x0, y0, x1 - x0, y1 - y0);
  }
}

/**
 * @param {number} value
 * @param {number} a
 * @param {number} b
 */
function isBetween(value, a, b) {
  return value >= Math.min(a, b) && value <= Math.max(a, b);
}

/**
 * Return the one nearest to the pointer, if it is near enough.
 *
 * @template {{ x: number, y: number }} Drawn
 * @param {Drawn[]} drawn
 * @param {PointerEvent} event
 */
function nearest(drawn, event) {
  /** @param {Drawn} one */
  const apart = ({ x, y }) => Math.hypot(x - event.offsetX, y - event.offsetY);
  return drawn.filter((one) => apart(one) < HIT_PX).sort((a, b) => apart(a) - apart(b))[0];
}
