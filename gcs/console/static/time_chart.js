// Base of all charts over the time of the run: margins, times, cursors, and the longest gap that lines bridge.

/**
 * @import { Series } from "../page_types.d.ts"
 * @import { Context } from "./canvas.js"
 * @import { Theme } from "./theme.js"
 * @import { TimeAxis } from "./time_axis.js"
 *
 * @typedef {object} Shared what all charts of the page share
 * @property {HTMLElement} root
 * @property {TimeAxis} axis
 * @property {Theme} theme
 * @property {(at: number) => void} seek
 */

import { contextOf, FAMILY, fit, strokeLine } from "./canvas.js";
import { el } from "./dom.js";
import { duration } from "./format.js";

export const LEFT = 40;
export const TOP = 6;
const RIGHT = 26;
const BOTTOM = 20;
const FONT = `11px ${FAMILY}`;
const DRAG_PX = 5;
const TIMES_PX = 55; // from one time on the axis to the next, at least
const GAP_S = 12; // longer gaps between values are shown

/** The whole chart is drawn anew whenever the axis changes. */
export class Chart {
  /**
   * @param {Shared} shared
   * @param {string} title
   */
  constructor({ root, axis, theme, seek }, title) {
    this.axis = axis;
    this.theme = theme;
    this.seek = seek;
    this.width = 0;
    /**
     * Height of the pointer on the canvas.
     *
     * @type {number | null}
     */
    this.y = null;
    /** @type {number | null} */
    this.pressedX = null;
    this.isDragged = false;
    this.values = el("div", { class: "values" });
    this.canvas = el("canvas", { role: "img", "aria-label": title });
    this.ctx = contextOf(this.canvas);
    this.figure = el("figure", { hidden: true }, el("figcaption", {}, title), this.values, this.canvas);
    root.append(this.figure);
    this.listen();
  }

  listen() {
    const { axis, canvas } = this;
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerup", () => {
      this.pressedX = null;
      if (axis.drawn) axis.zoom(axis.drawn);
    });
    canvas.addEventListener("pointercancel", () => {
      this.pressedX = null;
      axis.drawn = null;
    });
    canvas.addEventListener("pointerleave", () => {
      this.y = null;
      axis.point(null);
    });
    canvas.addEventListener("click", (event) => {
      const at = Math.min(axis.to, Math.max(0, this.timeAt(event.offsetX)));
      if (!this.isDragged) this.seek(at);
    });
    axis.addEventListener("change", () => this.draw());
  }

  /** @param {PointerEvent} event */
  down(event) {
    this.isDragged = false;
    this.pressedX = event.offsetX;
    this.canvas.setPointerCapture(event.pointerId);
  }

  /** @param {PointerEvent} event */
  move(event) {
    const at = this.timeAt(event.offsetX);
    this.y = event.offsetY;
    if (this.pressedX !== null) {
      if (Math.abs(event.offsetX - this.pressedX) > DRAG_PX) this.isDragged = true;
      if (this.isDragged) this.axis.drawn = [this.timeAt(this.pressedX), at];
    }
    this.axis.point(at);
  }

  get right() {
    return this.width - RIGHT;
  }

  /** Longest gap between values that are joined. */
  get maxGap() {
    return Math.max(GAP_S, 3 * this.axis.width);
  }

  /** @param {number} at */
  x(at) {
    const [from, to] = this.axis.span;
    return LEFT + (this.right - LEFT) * ((at - from) / (to - from));
  }

  /** @param {number} x */
  timeAt(x) {
    const [from, to] = this.axis.span;
    return from + ((x - LEFT) / Math.max(1, this.right - LEFT)) * (to - from);
  }

  /**
   * Return the bin of the value that is read off a series; -1 if there is none.
   *
   * @param {Series} values
   */
  index(values) {
    const at = Math.min(values.length - 1, Math.floor(this.axis.read / this.axis.width));
    for (let index = at; index >= 0 && (at - index) * this.axis.width <= this.maxGap; index--) {
      if (values[index] !== null) return index;
    }
    return -1;
  }

  /** Draw the chart; those that have nothing to show are hidden. */
  draw() {
    if (this.figure.hidden || !this.canvas.clientWidth) return;
    const { canvas, ctx } = this;
    const bottom = TOP + this.contentHeight();
    const height = bottom + BOTTOM;
    this.width = canvas.clientWidth;
    canvas.style.height = `${height}px`;
    fit(ctx, this.width, height);
    ctx.font = FONT;
    this.drawTimes(ctx, bottom);
    this.drawContent(ctx);
    this.drawCursors(ctx, bottom);
    this.values.replaceChildren(...this.legend());
  }

  /** Height of what is between the margins. */
  contentHeight() {
    return 0;
  }

  /** @param {Context} _ctx */
  drawContent(_ctx) {}

  /** @returns {Node[]} */
  legend() {
    return [];
  }

  /**
   * @param {Context} ctx
   * @param {number} bottom
   */
  drawTimes(ctx, bottom) {
    ctx.textAlign = "center";
    ctx.strokeStyle = this.theme.colour("grid");
    ctx.fillStyle = this.theme.colour("dim");
    for (const at of this.axis.roundTimes(this.timeAt(TIMES_PX) - this.timeAt(0))) {
      const x = Math.round(this.x(at)) + 0.5;
      strokeLine(ctx, [
        [x, TOP],
        [x, bottom],
      ]);
      ctx.fillText(duration(at), x, bottom + BOTTOM - 4);
    }
  }

  /**
   * Draw the span that the pointer draws, the time of the replay, and that of the pointer.
   *
   * @param {Context} ctx
   * @param {number} bottom
   */
  drawCursors(ctx, bottom) {
    const { now, pointed, drawn } = this.axis;
    ctx.lineWidth = 1;
    if (drawn) {
      const [from, to] = [this.x(drawn[0]), this.x(drawn[1])];
      ctx.fillStyle = this.theme.colour("advisory");
      ctx.globalAlpha = 0.2;
      ctx.fillRect(from, TOP, to - from, bottom - TOP);
      ctx.globalAlpha = 1;
    }
    if (now !== null) this.drawCursor(ctx, now, "advisory", bottom);
    if (pointed !== null) this.drawCursor(ctx, pointed, "dim", bottom);
  }

  /**
   * @param {Context} ctx
   * @param {number} at
   * @param {string} colour
   * @param {number} bottom
   */
  drawCursor(ctx, at, colour, bottom) {
    if (!this.axis.shows(at)) return;
    const x = this.x(at);
    ctx.strokeStyle = this.theme.colour(colour);
    strokeLine(ctx, [
      [x, TOP],
      [x, bottom],
    ]);
  }
}
