// Marks: losses, arrivals, plans, failed uploads, alarms and orders of the run, which the server lists.

import { duration } from "./format.js";

const POLL_MS = 1000;
const LIVE_MS = 3000;

// From the most urgent to the least. Each kind has a shape of its own beside its colour.
export const KINDS = {
  lost: { title: "Lost", colour: "warning", shape: "cross" },
  alarm: { title: "Alarms", colour: "warning", shape: "up" },
  upload: { title: "Failed uploads", colour: "caution", shape: "down" },
  plan: { title: "Plans", colour: "advisory", shape: "dot" },
  arrived: { title: "Arrivals", colour: "done", shape: "diamond" },
  order: { title: "Orders", colour: "text", shape: "square" },
  ended: { title: "End", colour: "dim", shape: "square" },
};

export const markText = ({ t_s: at, text }) => `${duration(at)}  ${text}`;

// Fetches marks while a page shows them.
export class Marks extends EventTarget {
  constructor(feed) {
    super();
    this.feed = feed;
    this.all = [];
    this.complete = false;
    this.users = 0;
    feed.on(["mission"], ({ mission }) => {
      if (mission.begun === this.run) return;
      this.run = mission.begun;
      this.all = [];
      this.complete = false;
      this.plan(0);
    });
  }

  want() {
    this.users++;
    this.plan(0);
  }

  release() {
    this.users--;
  }

  plan(after) {
    if (this.users && !this.complete) this.timer ??= setTimeout(() => this.load(), after);
  }

  async load() {
    const run = this.run;
    try {
      const reply = await fetch(`api/marks?after=${this.all.length}`);
      const { marks, complete } = await reply.json();
      if (run === this.run) {
        this.complete = complete;
        if (marks.length) this.all.push(...marks);
        if (marks.length || complete) this.dispatchEvent(new Event("change"));
      }
    } catch {
      /* the server is away: the feed says so */
    }
    this.timer = null;
    this.plan(this.feed.data.mission?.kind === "live" ? LIVE_MS : POLL_MS);
  }

  // The mark nearest to a time, within some seconds.
  near(at, within) {
    const apart = (mark) => Math.abs(mark.t_s - at);
    return this.all.filter((mark) => apart(mark) <= within).sort((a, b) => apart(a) - apart(b))[0];
  }
}

export function drawMark(ctx, shape, x, y, size) {
  ctx.beginPath();
  if (shape === "cross") {
    ctx.lineWidth = 2;
    for (const side of [-1, 1]) {
      ctx.moveTo(x - size, y - side * size);
      ctx.lineTo(x + size, y + side * size);
    }
    ctx.stroke();
    return;
  }
  if (shape === "dot") ctx.arc(x, y, size * 0.8, 0, 2 * Math.PI);
  else if (shape === "square") ctx.rect(x - size * 0.7, y - size * 0.7, size * 1.4, size * 1.4);
  else {
    const corners = {
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
    };
    corners[shape].forEach(([right, down], index) =>
      ctx[index ? "lineTo" : "moveTo"](x + right * size, y + down * size),
    );
  }
  ctx.closePath();
  ctx.fill();
}
