// Labels of the map. The first one at a place is drawn; others that would cover it are left out.

/** @import { Context } from "./canvas.js" */

const CELL_X = 22;
const CELL_Y = 13;
const CHARACTER_PX = 7;

export class Labels {
  /** @param {Context} ctx */
  constructor(ctx) {
    this.ctx = ctx;
    /** @type {Set<number>} */
    this.taken = new Set();
  }

  /**
   * Draw a label, unless it would overlap.
   *
   * @param {string} text
   * @param {number} x
   * @param {number} y
   * @param {boolean} must draw it anyway
   * @param {boolean} isStruck
   */
  draw(text, x, y, must = false, isStruck = false) {
    const cells = this.cells(text.length * CHARACTER_PX, x, y);
    if (!must && cells.some((cell) => this.taken.has(cell))) return;
    for (const cell of cells) this.taken.add(cell);
    this.ctx.fillText(text, x, y);
    if (isStruck) this.ctx.fillRect(x, y - 4, this.ctx.measureText(text).width, 1);
  }

  /**
   * @param {number} width
   * @param {number} x
   * @param {number} y
   */
  cells(width, x, y) {
    const row = Math.floor(y / CELL_Y);
    const cells = [];
    for (let column = Math.floor(x / CELL_X); column <= Math.floor((x + width) / CELL_X); column++)
      cells.push(row * 1000 + column);
    return cells;
  }
}
