// Marks of the run, which the server lists: losses, arrivals, plans, failed uploads, alarms and orders.

/**
 * @import { Mark, MarkKind, MarksReply } from "../page_types.d.ts"
 * @import { Context } from "./canvas.js"
 * @import { Feed } from "./feed.js"
 *
 * @typedef {"cross" | "dot" | "square" | keyof typeof CORNERS} Shape
 * @typedef {{ title: string, colour: string, shape: Shape }} MarkStyle
 */

import { duration } from "./format.js";

const POLL_MS = 1000;
const LIVE_MS = 3000;

/**
 * From the most urgent to the least. Each kind has a shape of its own beside its colour.
 *
 * @type {Record<MarkKind, MarkStyle>}
 */
export const MARK_STYLES = {
  lost: { title: "Lost", colour: "warning", shape: "cross" },
  down: { title: "Down", colour: "warning", shape: "bar" },
  alarm: { title: "Alarms", colour: "warning", shape: "up" },
  upload: { title: "Failed uploads", colour: "caution", shape: "down" },
  plan: { title: "Plans", colour: "advisory", shape: "dot" },
  arrived: { title: "Arrivals", colour: "done", shape: "diamond" },
  order: { title: "Orders", colour: "text", shape: "square" },
  ended: { title: "End", colour: "dim", shape: "square" },
};

/** Right and down from the centre, in units of the size. */
const CORNERS = {
  up: [
    [0, -1],
    [1, 0.8],
    [-1, 0.8],
  ],
  down: [
    [0, 1],
    [1, -0.8],
    [-1, -0.8],
  ],
  diamond: [
    [0, -1.1],
    [1.1, 0],
    [0, 1.1],
    [-1.1, 0],
  ],
  bar: [
    [-1.1, -0.35],
    [1.1, -0.35],
    [1.1, 0.35],
    [-1.1, 0.35],
  ],
};

/** @param {Mark} mark */
export const markText = ({ t_s: at, text }) => `${duration(at)}  ${text}`;

/**
 * Return the mark nearest to a time, within some seconds.
 *
 * @template {Mark} Found
 * @param {Found[]} marks
 * @param {number} at
 * @param {number} within
 * @returns {Found | undefined}
 */
export function nearestMark(marks, at, within) {
  /** @param {Mark} mark */
  const apart = (mark) => Math.abs(mark.t_s - at);
  return marks.filter((mark) => apart(mark) <= within).sort((a, b) => apart(a) - apart(b))[0];
}

/** Fetches marks while a part of the page shows them. */
export class Marks extends EventTarget {
  /** @param {Feed} feed */
  constructor(feed) {
    super();
    this.feed = feed;
    /** @type {Mark[]} */
    this.all = [];
    this.isComplete = false;
    this.isWaiting = false;
    this.users = 0;
    this.run = "";
    feed.on("mission", ({ begun }) => {
      if (begun === this.run) return;
      this.run = begun;
      this.all = [];
      this.isComplete = false;
      this.loadAfter(0);
    });
  }

  want() {
    this.users++;
    this.loadAfter(0);
  }

  release() {
    this.users--;
  }

  /** @param {number} delayMs */
  loadAfter(delayMs) {
    if (!this.users || this.isComplete || this.isWaiting) return;
    this.isWaiting = true;
    setTimeout(() => this.load(), delayMs);
  }

  async load() {
    const { run } = this;
    try {
      const reply = await fetch(`api/marks?after=${this.all.length}`);
      /** @type {MarksReply} */
      const { marks, complete } = await reply.json();
      if (run === this.run) {
        this.isComplete = complete;
        this.all.push(...marks);
        if (marks.length || complete) this.dispatchEvent(new Event("change"));
      }
    } catch {
      // The server is away: the header says so.
    }
    this.isWaiting = false;
    this.loadAfter(this.feed.data.mission?.kind === "live" ? LIVE_MS : POLL_MS);
  }
}

/**
 * @param {Context} ctx
 * @param {Shape} shape
 * @param {number} x
 * @param {number} y
 * @param {number} size half the width
 */
export function drawMark(ctx, shape, x, y, size) {
  ctx.beginPath();
  if (shape === "cross") {
    ctx.lineWidth = 2;
    for (const side of [-size, size]) {
      ctx.moveTo(x - size, y - side);
      ctx.lineTo(x + size, y + side);
    }
    ctx.stroke();
    return;
  }
  if (shape === "dot") ctx.arc(x, y, size * 0.8, 0, 2 * Math.PI);
  else if (shape === "square") ctx.rect(x - size * 0.7, y - size * 0.7, size * 1.4, size * 1.4);
  else for (const [right, down] of CORNERS[shape]) ctx.lineTo(x + right * size, y + down * size);
  ctx.closePath();
  ctx.fill();
}
