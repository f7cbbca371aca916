// Charts over the time of the run: lines, rows of bars, and rows of marks, on one canvas each.

import { el } from "./dom.js";
import { duration } from "./format.js";
import { drawMark } from "./marks.js";

const LEFT = 40;
const RIGHT = 26;
const TOP = 6;
const BOTTOM = 20;
const LINES_PX = 92;
const ROW_PX = 12;
const LOW_ROW_PX = 6; // with many rows; then only some have their names beside them
const MANY_ROWS = 24;
const FONT = '11px system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif';
const GAP_S = 12; // longer gaps between values are shown
const STEPS_S = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400];
const MAX_NAMED = 8;
const DRAG_PX = 5;
const MIN_SPAN_S = 1;

// What all charts share: the span of time, the time of the replay, the time under the pointer, and the span
// that the pointer draws.
export class TimeAxis extends EventTarget {
  constructor() {
    super();
    Object.assign(this, { to: 10, now: null, pointed: null, width: 0.5, zoomed: null, drawn: null });
  }

  get span() {
    return this.zoomed ?? [0, this.to];
  }

  shows(at) {
    return at !== null && at >= this.span[0] && at <= this.span[1];
  }

  // Shows a span of time, or the whole run.
  zoom(span) {
    this.drawn = null;
    const from = span && Math.max(0, Math.min(...span, this.to - MIN_SPAN_S));
    this.zoomed = span && [from, Math.min(this.to, Math.max(...span, from + MIN_SPAN_S))];
    this.dispatchEvent(new Event("zoom"));
    this.point(this.pointed);
  }

  point(at) {
    this.pointed = at;
    this.dispatchEvent(new Event("change"));
  }
}

class Chart {
  constructor(root, title, axis, theme, seek) {
    this.axis = axis;
    this.theme = theme;
    this.values = el("div", { class: "values" });
    this.canvas = el("canvas", { role: "img", "aria-label": title });
    this.root = el("figure", {}, el("figcaption", {}, title), this.values, this.canvas);
    root.append(this.root);
    this.canvas.addEventListener("pointerdown", (event) => {
      this.isDragged = false;
      this.pressedX = event.offsetX;
      this.canvas.setPointerCapture(event.pointerId);
    });
    this.canvas.addEventListener("pointermove", (event) => {
      const at = this.timeAt(event.offsetX);
      this.y = event.offsetY;
      if (this.pressedX !== null && Math.abs(event.offsetX - this.pressedX) > DRAG_PX) this.isDragged = true;
      if (this.pressedX !== null && this.isDragged) axis.drawn = [this.timeAt(this.pressedX), at];
      axis.point(at);
    });
    this.canvas.addEventListener("pointerup", () => {
      this.pressedX = null;
      if (axis.drawn) axis.zoom(axis.drawn);
    });
    this.canvas.addEventListener("pointercancel", () => {
      this.pressedX = axis.drawn = null;
    });
    this.canvas.addEventListener("pointerleave", () => {
      this.y = null;
      axis.point(null);
    });
    this.canvas.addEventListener("click", (event) => {
      if (!this.isDragged) seek(Math.min(axis.to, Math.max(0, this.timeAt(event.offsetX))));
    });
    this.pressedX = null;
    axis.addEventListener("change", () => this.draw());
  }

  x(at) {
    const [from, to] = this.axis.span;
    return LEFT + (this.width - LEFT - RIGHT) * ((at - from) / (to - from));
  }

  timeAt(x) {
    const [from, to] = this.axis.span;
    return from + ((x - LEFT) / Math.max(1, this.width - LEFT - RIGHT)) * (to - from);
  }

  // The time whose values are written: under the pointer, else now.
  get shown() {
    const { pointed, now, span } = this.axis;
    return this.axis.shows(pointed) ? pointed : (now ?? span[1]);
  }

  index(values) {
    const at = Math.min(values.length - 1, Math.floor(this.shown / this.axis.width));
    for (
      let index = at;
      index >= 0 && (at - index) * this.axis.width <= Math.max(GAP_S, 3 * this.axis.width);
      index--
    ) {
      if (values[index] !== null) return index;
    }
    return -1;
  }

  begin(height) {
    this.width = this.canvas.clientWidth;
    if (!this.width) return null;
    const ratio = window.devicePixelRatio || 1;
    const [across, down] = [Math.round(this.width * ratio), Math.round(height * ratio)];
    if (this.canvas.height !== down) this.canvas.style.height = `${height}px`;
    this.canvas.width = across;
    this.canvas.height = down;
    const ctx = this.canvas.getContext("2d");
    ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
    ctx.font = FONT;
    this.drawTimes(ctx, height);
    return ctx;
  }

  drawTimes(ctx, height) {
    const step = STEPS_S.find((one) => this.x(one) - this.x(0) > 55) ?? 28800;
    ctx.textAlign = "center";
    const [from, to] = this.axis.span;
    for (let at = step * Math.ceil(from / step); at <= to; at += step) {
      const x = Math.round(this.x(at)) + 0.5;
      ctx.strokeStyle = this.theme.colour("grid");
      stroke(ctx, [
        [x, TOP],
        [x, height - BOTTOM],
      ]);
      ctx.fillStyle = this.theme.colour("dim");
      ctx.fillText(duration(at), x, height - 4);
    }
  }

  // The replay's time, and the pointer's.
  end(ctx, height) {
    const { now, pointed, drawn } = this.axis;
    ctx.lineWidth = 1;
    if (drawn) {
      ctx.fillStyle = this.theme.colour("advisory");
      ctx.globalAlpha = 0.2;
      ctx.fillRect(this.x(drawn[0]), TOP, this.x(drawn[1]) - this.x(drawn[0]), height - TOP - BOTTOM);
      ctx.globalAlpha = 1;
    }
    for (const [at, colour] of [
      [now, "advisory"],
      [pointed, "dim"],
    ]) {
      if (!this.axis.shows(at)) continue;
      ctx.strokeStyle = this.theme.colour(colour);
      stroke(ctx, [
        [this.x(at), TOP],
        [this.x(at), height - BOTTOM],
      ]);
    }
  }

  name(parts) {
    this.values.replaceChildren(...parts);
  }
}

// Lines: [{ name, values, colour, dash, spread, hidden }], unnamed beyond a number of them.
export class LineChart extends Chart {
  constructor(root, title, unit, axis, theme, seek, { digits = 0, least = 1 } = {}) {
    super(root, unit ? `${title}, ${unit}` : title, axis, theme, seek);
    this.digits = digits;
    this.least = least; // of the end of the axis
    this.lines = [];
  }

  show(lines) {
    this.lines = lines;
    this.root.hidden = !lines.some((line) => line.values.some((value) => value !== null));
    this.draw();
  }

  draw() {
    if (this.root.hidden) return;
    const height = TOP + LINES_PX + BOTTOM;
    const ctx = this.begin(height);
    if (!ctx) return;
    const top = niceTop(
      Math.max(
        ...this.lines.map(({ values, spread }) =>
          values.reduce((most, value, i) => Math.max(most, (value ?? 0) + (spread?.[i] ?? 0)), this.least),
        ),
      ),
    );
    const y = (value) => TOP + LINES_PX * (1 - value / top.max);
    ctx.textAlign = "right";
    for (let value = 0; value <= top.max * 1.001; value += top.step) {
      ctx.strokeStyle = this.theme.colour("grid");
      stroke(ctx, [
        [LEFT, y(value)],
        [this.width - RIGHT, y(value)],
      ]);
      ctx.fillStyle = this.theme.colour("dim");
      ctx.fillText(String(Number(value.toPrecision(3))), LEFT - 5, y(value) + 3);
    }
    const named = this.lines.filter((line) => !line.faint);
    this.tags = [];
    for (const line of this.lines) this.drawLine(ctx, line, y);
    this.end(ctx, height);
    this.name(named.slice(0, MAX_NAMED).map((line) => this.legend(line)));
  }

  drawLine(ctx, { values, colour, dash, spread, faint, wide, tag }, y) {
    const { width } = this.axis;
    const tint = this.theme.colour(colour);
    const most = Math.max(GAP_S, 3 * width);
    const runs = [];
    let last = -Infinity;
    values.forEach((value, index) => {
      if (value === null || !this.axis.shows((index + 0.5) * width)) return;
      if ((index - last) * width > most) runs.push([]);
      runs.at(-1).push(index);
      last = index;
    });
    const at = (index) => this.x((index + 0.5) * width);
    if (spread) {
      ctx.fillStyle = tint;
      ctx.globalAlpha = 0.22;
      for (const run of runs) {
        ctx.beginPath();
        for (const index of run) ctx.lineTo(at(index), y(values[index] + (spread[index] ?? 0)));
        for (const index of [...run].reverse())
          ctx.lineTo(at(index), y(Math.max(0, values[index] - (spread[index] ?? 0))));
        ctx.fill();
      }
    }
    ctx.globalAlpha = faint ? 0.35 : 1;
    ctx.strokeStyle = ctx.fillStyle = tint;
    ctx.lineWidth = wide ? 4 : faint ? 1 : 1.6;
    if (wide) ctx.globalAlpha = 0.35;
    ctx.setLineDash(dash ?? []);
    for (const run of runs) {
      stroke(
        ctx,
        run.map((index) => [at(index), y(values[index])]),
      );
      if (run.length === 1) ctx.fillRect(at(run[0]) - 1.5, y(values[run[0]]) - 1.5, 3, 3);
    }
    ctx.setLineDash([]);
    ctx.globalAlpha = 1;
    if (tag && runs.length) {
      const end = runs.at(-1).at(-1);
      const [right, down] = [at(end) + 3, y(values[end]) + 4];
      if (this.tags.some(([x, above]) => Math.abs(x - right) < 14 && Math.abs(above - down) < 9)) return;
      this.tags.push([right, down]);
      ctx.textAlign = "left";
      ctx.fillText(tag, right, down);
    }
  }

  legend({ name, values, colour, dash, spread, wide }) {
    const index = this.index(values);
    const number = (value) => value.toFixed(this.digits);
    const text =
      index < 0 ? "–" : number(values[index]) + (spread?.[index] ? ` ± ${number(spread[index])}` : "");
    return el("span", {}, swatch(this.theme.colour(colour), dash, wide), `${name} `, el("b", {}, text));
  }
}

// One row for each name; the darker a bar, the nearer its value is to 1.
export class RowChart extends Chart {
  show(rows) {
    this.rows = rows;
    this.root.hidden = !rows.length;
    this.draw();
  }

  draw() {
    if (this.root.hidden || !this.rows) return;
    const rowPx = this.rows.length > MANY_ROWS ? LOW_ROW_PX : ROW_PX;
    const height = TOP + rowPx * this.rows.length + BOTTOM;
    const ctx = this.begin(height);
    if (!ctx) return;
    const { width } = this.axis;
    const pointed = this.y ? this.rows[Math.floor((this.y - TOP) / rowPx)] : null;
    this.rows.forEach((row, number) => {
      const y = TOP + number * rowPx;
      ctx.textAlign = "right";
      ctx.fillStyle = this.theme.colour(row === pointed ? "text" : "dim");
      if (rowPx === ROW_PX || (number * rowPx) % ROW_PX === 0) ctx.fillText(row.name, LEFT - 5, y + 10);
      ctx.fillStyle = this.theme.colour(row.colour);
      row.values.forEach((value, index) => {
        if (value === null) return;
        let next = index + 1;
        while (
          next < row.values.length &&
          row.values[next] === null &&
          (next - index) * width < Math.max(3, 2 * width)
        )
          next++;
        ctx.globalAlpha = Math.max(0.06, value);
        if (!this.axis.shows(index * width) && !this.axis.shows(next * width)) return;
        const [from, to] = [index, next].map((bin) =>
          Math.round(Math.min(this.width - RIGHT, Math.max(LEFT, this.x(bin * width)))),
        );
        ctx.fillRect(from, y + 1, Math.max(1, to - from), rowPx - (rowPx === ROW_PX ? 3 : 1));
      });
      ctx.globalAlpha = 1;
    });
    this.end(ctx, height);
    const index = pointed ? this.index(pointed.values) : -1;
    this.name([
      el(
        "span",
        {},
        pointed ? `${pointed.name} ` : "point at a track to read its value",
        el("b", {}, index < 0 ? "" : pointed.values[index].toFixed(2)),
      ),
    ]);
  }
}

// One row for each kind of mark.
export class MarkChart extends Chart {
  show(marks, kinds, text) {
    this.marks = marks;
    this.kinds = Object.entries(kinds).filter(([kind]) => marks.some((mark) => mark.kind === kind));
    this.text = text;
    this.root.hidden = !this.kinds.length;
    this.draw();
  }

  near() {
    const row = this.kinds[Math.floor(((this.y ?? -1) - TOP) / 16)]?.[0];
    const within = this.timeAt(8) - this.timeAt(0);
    const apart = (mark) => Math.abs(mark.t_s - this.axis.pointed);
    return this.axis.pointed === null
      ? null
      : this.marks
          .filter((mark) => mark.kind === row && apart(mark) < within)
          .sort((a, b) => apart(a) - apart(b))[0];
  }

  draw() {
    if (this.root.hidden || !this.marks) return;
    const height = TOP + 16 * this.kinds.length + BOTTOM;
    const ctx = this.begin(height);
    if (!ctx) return;
    this.kinds.forEach(([kind, { colour, shape }], number) => {
      const y = TOP + number * 16 + 8;
      ctx.fillStyle = ctx.strokeStyle = this.theme.colour(colour);
      for (const mark of this.marks)
        if (mark.kind === kind && this.axis.shows(mark.t_s)) drawMark(ctx, shape, this.x(mark.t_s), y, 4);
    });
    this.end(ctx, height);
    const mark = this.near();
    const key = this.kinds.map(([, { title, colour, shape }]) =>
      el("span", {}, symbol(this.theme.colour(colour), shape), title),
    );
    this.name(mark ? [el("span", {}, this.text(mark))] : key);
  }
}

function swatch(colour, dash, wide) {
  const canvas = el("canvas", { width: "18", height: "8", "aria-hidden": "true" });
  const ctx = canvas.getContext("2d");
  ctx.strokeStyle = colour;
  ctx.lineWidth = wide ? 5 : 2;
  if (wide) ctx.globalAlpha = 0.4;
  ctx.setLineDash(dash ?? []);
  stroke(ctx, [
    [0, 4],
    [18, 4],
  ]);
  return canvas;
}

function symbol(colour, shape) {
  const canvas = el("canvas", { width: "12", height: "12", "aria-hidden": "true" });
  const ctx = canvas.getContext("2d");
  ctx.strokeStyle = ctx.fillStyle = colour;
  drawMark(ctx, shape, 6, 6, 4);
  return canvas;
}

function stroke(ctx, points) {
  ctx.beginPath();
  for (const [x, y] of points) ctx.lineTo(x, y);
  ctx.stroke();
}

// The end of an axis from 0, and the step of its numbers.
function niceTop(most) {
  const rough = most / 3;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 2.5, 5, 10].map((one) => one * power).find((one) => one >= rough * 0.999);
  return { step, max: step * Math.max(1, Math.ceil((most / step) * 0.999)) };
}
