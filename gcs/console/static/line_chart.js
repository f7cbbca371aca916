// Chart of lines over the time of the run.

/**
 * @import { Series } from "../page_types.d.ts"
 * @import { Context } from "./canvas.js"
 * @import { Shared } from "./time_chart.js"
 *
 * @typedef {object} Line
 * @property {string} name
 * @property {Series} values
 * @property {string} colour
 * @property {number[]} [dash]
 * @property {Series} [spread] one standard deviation of each value
 * @property {boolean} [isWide]
 * @property {boolean} [isFaint] without a name
 * @property {string} [tag] text at its end
 *
 * @typedef {(value: number) => number} Scale from a value to a height on the canvas
 */

import { contextOf, strokeLine } from "./canvas.js";
import { el } from "./dom.js";
import { Chart, LEFT, TOP } from "./time_chart.js";

const HEIGHT = 92;
const MAX_NAMED = 8;
const SPREAD_OPACITY = 0.22;
const FAINT_OPACITY = 0.35;

export class LineChart extends Chart {
  /**
   * @param {Shared} shared
   * @param {string} title
   * @param {{ digits?: number, least?: number }} options digits of values; the least end of the axis
   */
  constructor(shared, title, { digits = 0, least = 1 } = {}) {
    super(shared, title);
    this.digits = digits;
    this.least = least;
    /** @type {Line[]} */
    this.lines = [];
    /** @type {[x: number, y: number][]} */
    this.tags = [];
  }

  /** @param {Line[]} lines */
  show(lines) {
    this.lines = lines;
    this.figure.hidden = !lines.some((line) => line.values.some((value) => value !== null));
    this.draw();
  }

  /** @override */
  contentHeight() {
    return HEIGHT;
  }

  /**
   * @override
   * @param {Context} ctx
   */
  drawContent(ctx) {
    const top = topOf(this.lines, this.least);
    /** @type {Scale} */
    const y = (value) => TOP + HEIGHT * (1 - value / top.max);
    this.drawValues(ctx, top, y);
    this.tags = [];
    for (const line of this.lines) {
      const runs = this.runs(line.values);
      if (line.spread) this.drawSpread(ctx, line, line.spread, runs, y);
      this.drawLine(ctx, line, runs, y);
      if (line.tag && runs.length) this.drawTag(ctx, line.tag, line.values, runs, y);
    }
  }

  /**
   * Draw the grid of values.
   *
   * @param {Context} ctx
   * @param {{ step: number, max: number }} top
   * @param {Scale} y
   */
  drawValues(ctx, { step, max }, y) {
    ctx.textAlign = "right";
    ctx.strokeStyle = this.theme.colour("grid");
    ctx.fillStyle = this.theme.colour("dim");
    for (let value = 0; value <= max * 1.001; value += step) {
      strokeLine(ctx, [
        [LEFT, y(value)],
        [this.right, y(value)],
      ]);
      ctx.fillText(String(Number(value.toPrecision(3))), LEFT - 5, y(value) + 3);
    }
  }

  /**
   * Return the bins that are shown, in runs without a longer gap.
   *
   * @param {Series} values
   */
  runs(values) {
    /** @type {number[][]} */
    const runs = [];
    let last = -Infinity;
    values.forEach((value, index) => {
      if (value === null || !this.axis.shows((index + 0.5) * this.axis.width)) return;
      if ((index - last) * this.axis.width > this.maxGap) runs.push([index]);
      else runs[runs.length - 1].push(index);
      last = index;
    });
    return runs;
  }

  /** @param {number} index */
  middle(index) {
    return this.x((index + 0.5) * this.axis.width);
  }

  /**
   * @param {Context} ctx
   * @param {Line} line
   * @param {Series} spread
   * @param {number[][]} runs
   * @param {Scale} y
   */
  drawSpread(ctx, { values, colour }, spread, runs, y) {
    ctx.fillStyle = this.theme.colour(colour);
    ctx.globalAlpha = SPREAD_OPACITY;
    for (const run of runs) {
      ctx.beginPath();
      for (const index of run) ctx.lineTo(this.middle(index), y(at(values, index) + at(spread, index)));
      for (const index of [...run].reverse())
        ctx.lineTo(this.middle(index), y(Math.max(0, at(values, index) - at(spread, index))));
      ctx.fill();
    }
    ctx.globalAlpha = 1;
  }

  /**
   * @param {Context} ctx
   * @param {Line} line
   * @param {number[][]} runs
   * @param {Scale} y
   */
  drawLine(ctx, { values, colour, dash = [], isFaint, isWide }, runs, y) {
    const tint = this.theme.colour(colour);
    ctx.strokeStyle = ctx.fillStyle = tint;
    ctx.globalAlpha = isFaint || isWide ? FAINT_OPACITY : 1;
    ctx.lineWidth = isWide ? 4 : isFaint ? 1 : 1.6;
    ctx.setLineDash(dash);
    for (const run of runs) {
      strokeLine(
        ctx,
        run.map((index) => [this.middle(index), y(at(values, index))]),
      );
      if (run.length === 1) ctx.fillRect(this.middle(run[0]) - 1.5, y(at(values, run[0])) - 1.5, 3, 3);
    }
    ctx.setLineDash([]);
    ctx.globalAlpha = 1;
  }

  /**
   * Write a text at the end of a line, unless another is there.
   *
   * @param {Context} ctx
   * @param {string} tag
   * @param {Series} values
   * @param {number[][]} runs
   * @param {Scale} y
   */
  drawTag(ctx, tag, values, runs, y) {
    const end = runs[runs.length - 1].at(-1) ?? 0;
    const [right, down] = [this.middle(end) + 3, y(at(values, end)) + 4];
    if (this.tags.some(([x, above]) => Math.abs(x - right) < 14 && Math.abs(above - down) < 9)) return;
    this.tags.push([right, down]);
    ctx.textAlign = "left";
    ctx.fillText(tag, right, down);
  }

  /** @override */
  legend() {
    const named = this.lines.filter((line) => !line.isFaint);
    return named.slice(0, MAX_NAMED).map((line) => {
      const { name, values, spread, colour, dash, isWide } = line;
      const index = this.index(values);
      const deviation = index < 0 ? null : spread?.[index];
      const value = index < 0 ? "–" : at(values, index).toFixed(this.digits);
      const text = deviation ? `${value} ± ${deviation.toFixed(this.digits)}` : value;
      const swatch = swatchOf(this.theme.colour(colour), dash, isWide);
      return el("span", {}, swatch, `${name} `, el("b", {}, text));
    });
  }
}

/**
 * @param {Series} values
 * @param {number} index
 */
function at(values, index) {
  return values[index] ?? 0;
}

/**
 * @param {string} colour
 * @param {number[]} [dash]
 * @param {boolean} [isWide]
 */
function swatchOf(colour, dash = [], isWide = false) {
  const canvas = el("canvas", { width: 18, height: 8, "aria-hidden": "true" });
  const ctx = contextOf(canvas);
  ctx.strokeStyle = colour;
  ctx.lineWidth = isWide ? 5 : 2;
  if (isWide) ctx.globalAlpha = 0.4;
  ctx.setLineDash(dash);
  strokeLine(ctx, [
    [0, 4],
    [18, 4],
  ]);
  return canvas;
}

/**
 * Return the end of an axis from 0 that shows all lines, and the step of its numbers.
 *
 * @param {Pick<Line, "values" | "spread">[]} lines
 * @param {number} least
 */
export function topOf(lines, least) {
  let most = least;
  for (const { values, spread = [] } of lines) {
    values.forEach((value, index) => {
      most = Math.max(most, (value ?? 0) + at(spread, index));
    });
  }
  const rough = most / 3;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * ([1, 2, 2.5, 5].find((one) => one * power >= rough * 0.999) ?? 10);
  return { step, max: step * Math.max(1, Math.ceil((most / step) * 0.999)) };
}
