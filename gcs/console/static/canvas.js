// Canvas: fitting it to its element and pixels, lines, fonts; shared by the map and all charts.

/**
 * @import { Point, TrailPoint } from "../page_types.d.ts"
 * @import { View } from "./map_view.js"
 *
 * @typedef {[east: number, north: number, radius: number]} Disc
 *
 * @typedef {CanvasRenderingContext2D} Context
 * @typedef {(name: string) => string} Colour colour by its name in the style sheet
 */

export const FAMILY = 'system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif';

/**
 * Return the context of a canvas.
 *
 * @param {HTMLCanvasElement} canvas
 * @param {CanvasRenderingContext2DSettings} [settings]
 */
export function contextOf(canvas, settings) {
  const ctx = canvas.getContext("2d", settings);
  if (!ctx) throw new Error("the browser cannot draw");
  return ctx;
}

/**
 * Fit the pixels of a canvas to its size; after that, units of drawing are those of the page.
 *
 * @param {Context} ctx
 * @param {number} width
 * @param {number} height
 */
export function fit(ctx, width, height) {
  const ratio = window.devicePixelRatio || 1;
  ctx.canvas.width = Math.round(width * ratio);
  ctx.canvas.height = Math.round(height * ratio);
  ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
}

/**
 * Return a function that draws with the next frame, however often it is called before.
 *
 * @param {() => void} draw
 */
export function oncePerFrame(draw) {
  let isDue = false;
  return () => {
    if (isDue) return;
    isDue = true;
    requestAnimationFrame(() => {
      isDue = false;
      draw();
    });
  };
}

/**
 * Add a line to the path. It ends at a gap, which is null, and begins again after it.
 *
 * @param {Context} ctx
 * @param {View} view
 * @param {(Point | TrailPoint | null)[]} points
 */
export function addLine(ctx, view, points) {
  let isBegun = false;
  for (const point of points) {
    if (point && isBegun) ctx.lineTo(view.x(point[0]), view.y(point[1]));
    else if (point) ctx.moveTo(view.x(point[0]), view.y(point[1]));
    isBegun = point !== null;
  }
}

/**
 * Begin a path that is a closed polygon.
 *
 * @param {Context} ctx
 * @param {View} view
 * @param {Point[]} points
 */
export function beginRing(ctx, view, points) {
  ctx.beginPath();
  addLine(ctx, view, points);
  ctx.closePath();
}

/**
 * Begin a path that is a circle.
 *
 * @param {Context} ctx
 * @param {View} view
 * @param {Disc} disc
 */
export function beginDisc(ctx, view, [east, north, radius]) {
  ctx.beginPath();
  ctx.arc(view.x(east), view.y(north), radius * view.scale, 0, 2 * Math.PI);
}

/**
 * Draw a line between points of the canvas.
 *
 * @param {Context} ctx
 * @param {[x: number, y: number][]} points
 */
export function strokeLine(ctx, points) {
  ctx.beginPath();
  for (const [x, y] of points) ctx.lineTo(x, y);
  ctx.stroke();
}
