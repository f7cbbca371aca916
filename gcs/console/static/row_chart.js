// Chart with one row for each name; the darker a bar, the nearer its value is to 1.

/**
 * @import { Series } from "../page_types.d.ts"
 * @import { Context } from "./canvas.js"
 * @import { Shared } from "./time_chart.js"
 *
 * @typedef {{ name: string, values: Series, colour: string }} Row
 */

import { el } from "./dom.js";
import { Chart, LEFT, TOP } from "./time_chart.js";

const ROW_PX = 12;
const LOW_ROW_PX = 6; // with many rows; then only some have their names beside them
const MANY_ROWS = 24;
const MIN_OPACITY = 0.06;
const MIN_JOINED_S = 3; // shorter gaps are drawn over

export class RowChart extends Chart {
  /**
   * @param {Shared} shared
   * @param {string} title
   */
  constructor(shared, title) {
    super(shared, title);
    /** @type {Row[]} */
    this.rows = [];
  }

  /** @param {Row[]} rows */
  show(rows) {
    this.rows = rows;
    this.figure.hidden = !rows.length;
    this.draw();
  }

  get rowPx() {
    return this.rows.length > MANY_ROWS ? LOW_ROW_PX : ROW_PX;
  }

  /** The row under the pointer. */
  get pointed() {
    return this.y ? this.rows[Math.floor((this.y - TOP) / this.rowPx)] : undefined;
  }

  /** @override */
  contentHeight() {
    return this.rowPx * this.rows.length;
  }

  /**
   * @override
   * @param {Context} ctx
   */
  drawContent(ctx) {
    const { rowPx, pointed } = this;
    ctx.textAlign = "right";
    this.rows.forEach((row, number) => {
      const y = TOP + number * rowPx;
      ctx.fillStyle = this.theme.colour(row === pointed ? "text" : "dim");
      if ((number * rowPx) % ROW_PX === 0) ctx.fillText(row.name, LEFT - 5, y + 10);
      this.drawBars(ctx, row, y + 1, rowPx === ROW_PX ? ROW_PX - 3 : LOW_ROW_PX - 1);
    });
    ctx.globalAlpha = 1;
  }

  /**
   * @param {Context} ctx
   * @param {Row} row
   * @param {number} y
   * @param {number} height
   */
  drawBars(ctx, { values, colour }, y, height) {
    const { width } = this.axis;
    ctx.fillStyle = this.theme.colour(colour);
    values.forEach((value, index) => {
      if (value === null) return;
      const next = this.nextBin(values, index);
      if (!this.axis.shows(index * width) && !this.axis.shows(next * width)) return;
      const [from, to] = [this.edge(index), this.edge(next)];
      ctx.globalAlpha = Math.max(MIN_OPACITY, value);
      ctx.fillRect(from, y, Math.max(1, to - from), height);
    });
    ctx.globalAlpha = 1;
  }

  /**
   * Return the bin at which the bar of a value ends: it covers a short gap after it.
   *
   * @param {Series} values
   * @param {number} index
   */
  nextBin(values, index) {
    const { width } = this.axis;
    const joined = Math.max(MIN_JOINED_S, 2 * width);
    let next = index + 1;
    while (next < values.length && values[next] === null && (next - index) * width < joined) next++;
    return next;
  }

  /** @param {number} bin */
  edge(bin) {
    return Math.round(Math.min(this.right, Math.max(LEFT, this.x(bin * this.axis.width))));
  }

  /** @override */
  legend() {
    const { pointed } = this;
    if (!pointed) return [el("span", {}, "point at a track to read its value")];
    const value = pointed.values[this.index(pointed.values)];
    return [el("span", {}, `${pointed.name} `, el("b", {}, value?.toFixed(2)))];
  }
}
