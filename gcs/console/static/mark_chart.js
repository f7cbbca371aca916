// Chart with one row for each kind of mark.

/**
 * @import { Mark, MarkKind } from "../page_types.d.ts"
 * @import { Context } from "./canvas.js"
 * @import { Shared } from "./time_chart.js"
 * @import { Shape } from "./run_marks.js"
 */

import { contextOf } from "./canvas.js";
import { el } from "./dom.js";
import { drawMark, MARK_STYLES, markText, nearestMark } from "./run_marks.js";
import { Chart, TOP } from "./time_chart.js";

const ROW_PX = 16;
const SIZE_PX = 4;
const HIT_PX = 8;

export class MarkChart extends Chart {
  /**
   * @param {Shared} shared
   * @param {string} title
   */
  constructor(shared, title) {
    super(shared, title);
    /** @type {Mark[]} */
    this.marks = [];
    /** @type {MarkKind[]} */
    this.kinds = [];
  }

  /** @param {Mark[]} marks */
  show(marks) {
    const kinds = /** @type {MarkKind[]} */ (Object.keys(MARK_STYLES));
    this.marks = marks;
    this.kinds = kinds.filter((kind) => marks.some((mark) => mark.kind === kind));
    this.figure.hidden = !this.kinds.length;
    this.draw();
  }

  /** @override */
  contentHeight() {
    return ROW_PX * this.kinds.length;
  }

  /**
   * @override
   * @param {Context} ctx
   */
  drawContent(ctx) {
    this.kinds.forEach((kind, number) => {
      const { colour, shape } = MARK_STYLES[kind];
      const y = TOP + (number + 0.5) * ROW_PX;
      ctx.fillStyle = ctx.strokeStyle = this.theme.colour(colour);
      for (const mark of this.marks) {
        if (mark.kind === kind && this.axis.shows(mark.t_s))
          drawMark(ctx, shape, this.x(mark.t_s), y, SIZE_PX);
      }
    });
  }

  /** Return the mark under the pointer. */
  pointed() {
    if (this.axis.pointed === null || this.y === null) return undefined;
    const kind = this.kinds[Math.floor((this.y - TOP) / ROW_PX)];
    const within = this.timeAt(HIT_PX) - this.timeAt(0);
    const row = this.marks.filter((mark) => mark.kind === kind);
    return nearestMark(row, this.axis.pointed, within);
  }

  /** @override */
  legend() {
    const mark = this.pointed();
    if (mark) return [el("span", {}, markText(mark))];
    return this.kinds.map((kind) => {
      const { title, colour, shape } = MARK_STYLES[kind];
      return el("span", {}, symbolOf(this.theme.colour(colour), shape), title);
    });
  }
}

/**
 * @param {string} colour
 * @param {Shape} shape
 */
function symbolOf(colour, shape) {
  const canvas = el("canvas", { width: 12, height: 12, "aria-hidden": "true" });
  const ctx = contextOf(canvas);
  ctx.strokeStyle = ctx.fillStyle = colour;
  drawMark(ctx, shape, 6, 6, SIZE_PX);
  return canvas;
}
