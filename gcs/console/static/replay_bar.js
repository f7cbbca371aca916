// Replay bar: play, pause, speed, position, and the events of the recording.

/**
 * @import { Mark, MarkKind, ReplayState } from "../page_types.d.ts"
 * @import { Theme } from "./theme.js"
 *
 * @typedef {Mark & { height?: number }} PlacedMark height: its place in the bar, 0 to 1
 *
 * @typedef {object} ReplayFeed
 * @property {{ replay?: ReplayState | null }} data
 * @property {(name: "replay", callback: () => void) => void} on
 *
 * @typedef {object} ReplayMarks
 * @property {PlacedMark[]} all
 * @property {() => void} want
 * @property {() => void} release
 * @property {(type: "change", callback: () => void) => void} addEventListener
 */

import { contextOf, fit } from "./canvas.js";
import { el, setText } from "./dom.js";
import { duration } from "./format.js";
import { errorOf, post } from "./requests.js";
import { drawMark, MARK_STYLES, markText, nearestMark } from "./run_marks.js";

const SPEEDS = [0.5, 1, 2, 5, 10, 50];
const SEEK_MS = 300; // between seeks while the bar is dragged
const THUMB_PX = 8; // half its width: the slider's ends are so far inside
const HIT_PX = 7;
const MARK_PX = 4;
const BEFORE_S = 1; // a jump shows what comes just before an event
const PASSED_S = 2;
const AHEAD_S = 0.2;

export class Replay {
  /**
   * @param {HTMLElement} root
   * @param {ReplayFeed} feed
   * @param {ReplayMarks} marks
   * @param {Theme} theme
   */
  constructor(root, feed, marks, theme) {
    this.root = root;
    this.feed = feed;
    this.marks = marks;
    this.theme = theme;
    this.isDragged = false;
    /**
     * Position that was asked for, until the replay has followed.
     *
     * @type {number | null}
     */
    this.sent = null;
    this.seeks = 0;
    this.isSeekDue = false;
    const titles = { title: "Play or pause (P)", onclick: () => this.toggle() };
    this.play = el("button", { class: "play", ...titles });
    this.at = el("span", { class: "at" });
    const label = "Position in the recording";
    this.slider = el("input", { type: "range", min: 0, step: 0.1, "aria-label": label });
    this.canvas = el("canvas", { class: "marks", "aria-hidden": "true" });
    this.ctx = contextOf(this.canvas);
    this.tip = el("div", { class: "tip", hidden: true });
    this.speed = el(
      "select",
      { "aria-label": "Speed", onchange: () => this.send({ speed: Number(this.speed.value) }) },
      ...SPEEDS.map((speed) => el("option", { value: speed }, `×${speed}`)),
    );
    this.problem = el("span", { class: "bad", role: "status" });
    root.append(
      this.play,
      button("|◂", "Event before (,)", () => this.jump(-1)),
      button("▸|", "Next event (.)", () => this.jump(1)),
      el("div", { class: "bar" }, this.canvas, this.slider, this.tip),
      this.at,
      this.speed,
      this.problem,
    );
    this.listen();
  }

  listen() {
    const { canvas, slider } = this;
    slider.addEventListener("input", () => {
      this.isDragged = true;
      this.showTime(Number(slider.value));
      this.seekSoon();
    });
    slider.addEventListener("change", () => {
      this.isDragged = false;
      this.seek(Number(slider.value));
    });
    canvas.addEventListener("pointermove", (event) => this.point(event));
    canvas.addEventListener("pointerleave", () => {
      this.tip.hidden = true;
    });
    canvas.addEventListener("click", (event) => {
      const mark = this.markAt(event);
      this.seek(mark ? timeBefore(mark) : this.timeAt(event));
    });
    new ResizeObserver(() => this.draw()).observe(canvas);
    this.theme.addEventListener("change", () => this.draw());
    this.marks.addEventListener("change", () => this.draw());
    this.feed.on("replay", () => this.show());
  }

  get state() {
    return this.feed.data.replay ?? null;
  }

  get isShown() {
    return this.state !== null;
  }

  get now() {
    return this.sent ?? this.state?.at_s ?? 0;
  }

  get duration() {
    return this.state?.duration_s || this.state?.at_s || 1;
  }

  /**
   * Select a speed, which may be one that was chosen on the command line.
   *
   * @param {number | null} speed
   */
  showSpeed(speed) {
    const value = String(speed);
    if (![...this.speed.options].some((option) => option.value === value))
      this.speed.append(el("option", { value }, speed === null ? "max" : `×${speed}`));
    this.speed.value = value;
  }

  show() {
    const { state } = this;
    if (this.root.hidden === this.isShown) {
      this.root.hidden = !this.isShown;
      if (this.isShown) this.marks.want();
      else this.marks.release();
    }
    if (!state) return;
    setText(this.play, state.paused || state.ended ? "Play" : "Pause");
    if (document.activeElement !== this.speed) this.showSpeed(state.speed);
    if (this.slider.max !== String(this.duration)) {
      this.slider.max = String(this.duration);
      this.draw();
    }
    if (!this.seeks) this.sent = null;
    if (!this.isDragged) this.showTime(this.now);
  }

  /** @param {number} at */
  showTime(at) {
    this.slider.value = String(at);
    const text = `${duration(at)} / ${duration(this.duration)}`;
    setText(this.at, text);
    this.slider.setAttribute("aria-valuetext", text);
  }

  toggle() {
    const { state } = this;
    if (!state) return;
    this.send(state.ended && state.back ? { paused: false, at_s: 0 } : { paused: !state.paused });
  }

  /**
   * Go some seconds on or back. Repeated keys add up before the replay has followed.
   *
   * @param {number} seconds
   */
  step(seconds) {
    this.seek(this.now + seconds);
  }

  /** @param {number} at */
  async seek(at) {
    if (!this.isShown) return;
    this.sent = Math.min(Math.max(0, at), this.duration);
    this.showTime(this.sent);
    this.seeks++;
    await this.send({ at_s: this.sent });
    this.seeks--;
  }

  /** Seek to where the slider is then. */
  seekSoon() {
    if (this.isSeekDue) return;
    this.isSeekDue = true;
    setTimeout(() => {
      this.isSeekDue = false;
      if (this.isDragged && this.state?.back) this.send({ at_s: Number(this.slider.value) });
    }, SEEK_MS);
  }

  /**
   * Jump to just before the next event, or the one before.
   *
   * @param {1 | -1} direction
   */
  jump(direction) {
    const now = this.now + BEFORE_S;
    const marks = this.marks.all;
    const next = marks.find((mark) => mark.t_s > now + AHEAD_S);
    const last = marks.filter((mark) => mark.t_s < now - PASSED_S).at(-1);
    if (direction > 0) this.seek(next ? timeBefore(next) : this.duration);
    else this.seek(last ? timeBefore(last) : 0);
  }

  /** @param {{ speed?: number, paused?: boolean, at_s?: number }} request */
  async send(request) {
    setText(this.problem, "");
    try {
      const reply = await post("/api/replay", request);
      if (reply.ok) return;
      setText(this.problem, await errorOf(reply));
      this.show();
    } catch {
      // The server is away: the header says so.
    }
  }

  get barWidth() {
    return Math.max(1, this.canvas.clientWidth - 2 * THUMB_PX);
  }

  /** @param {number} at */
  x(at) {
    return THUMB_PX + this.barWidth * (at / this.duration);
  }

  /** @param {MouseEvent} event */
  timeAt(event) {
    return ((event.offsetX - THUMB_PX) / this.barWidth) * this.duration;
  }

  /** @param {MouseEvent} event */
  markAt(event) {
    const within = (HIT_PX / this.barWidth) * this.duration;
    return nearestMark(this.marks.all, this.timeAt(event), within);
  }

  /** @param {PointerEvent} event */
  point(event) {
    const mark = this.markAt(event);
    this.tip.hidden = false;
    setText(this.tip, mark ? markText(mark) : duration(this.timeAt(event)));
    const maxLeft = this.canvas.clientWidth - this.tip.offsetWidth;
    const left = Math.max(0, Math.min(maxLeft, event.offsetX - this.tip.offsetWidth / 2));
    this.tip.style.left = `${left}px`;
  }

  draw() {
    const { canvas, ctx } = this;
    const { clientWidth: width, clientHeight: height } = canvas;
    if (!width) return;
    fit(ctx, width, height);
    const kinds = /** @type {MarkKind[]} */ (Object.keys(MARK_STYLES));
    for (const kind of kinds.reverse()) {
      const { colour, shape } = MARK_STYLES[kind];
      ctx.fillStyle = ctx.strokeStyle = this.theme.colour(colour);
      for (const mark of this.marks.all) {
        if (mark.kind === kind)
          drawMark(ctx, shape, this.x(mark.t_s), height * (mark.height ?? 0.5), MARK_PX);
      }
    }
  }
}

/** @param {Mark} mark */
function timeBefore(mark) {
  return Math.max(0, mark.t_s - BEFORE_S);
}

/**
 * @param {string} text
 * @param {string} label
 * @param {() => void} action
 */
function button(text, label, action) {
  return el("button", { "aria-label": label, title: label, onclick: action }, text);
}
