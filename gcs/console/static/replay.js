// Replay bar: play, pause, speed, position, and the events of the recording.

import { el, setText } from "./dom.js";
import { duration } from "./format.js";
import { drawMark, KINDS, markText } from "./marks.js";

const SPEEDS = [0.5, 1, 2, 5, 10, 50];
const SEEK_MS = 300; // between seeks while the bar is dragged
const THUMB_PX = 8; // half its width: the slider's ends are so far inside
const HIT_PX = 7;
const MARK_PX = 4;
const BEFORE_S = 1; // a jump shows what comes just before an event
const PASSED_S = 2;

export class Replay {
  constructor(root, feed, marks, theme) {
    this.root = root;
    this.feed = feed;
    this.marks = marks;
    this.theme = theme;
    this.dragging = false;
    this.sent = null; // position that was asked for, until the replay has followed
    this.seeks = 0;
    const button = (text, label, action) =>
      el("button", { "aria-label": label, title: label, onclick: action }, text);
    this.play = el("button", { class: "play", title: "Play or pause (P)", onclick: () => this.toggle() });
    this.at = el("span", { class: "at" });
    this.slider = el("input", {
      type: "range",
      min: "0",
      step: "0.1",
      "aria-label": "Position in the recording",
    });
    this.canvas = el("canvas", { class: "marks", "aria-hidden": "true" });
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
    this.slider.addEventListener("input", () => {
      this.dragging = true;
      this.showTime(Number(this.slider.value));
      this.seekSoon(Number(this.slider.value));
    });
    this.slider.addEventListener("change", () => {
      this.dragging = false;
      this.seek(Number(this.slider.value));
    });
    this.canvas.addEventListener("pointermove", (event) => this.point(event));
    this.canvas.addEventListener("pointerleave", () => {
      this.tip.hidden = true;
    });
    this.canvas.addEventListener("click", (event) => {
      const mark = this.markAt(event);
      this.seek(mark ? this.before(mark) : this.timeAt(event));
    });
    new ResizeObserver(() => this.draw()).observe(this.canvas);
    this.theme.addEventListener("change", () => this.draw());
    this.marks.addEventListener("change", () => this.draw());
    this.feed.on(["replay"], () => this.show());
  }

  get state() {
    return this.feed.data.replay ?? null;
  }

  get isShown() {
    return this.state !== null;
  }

  get now() {
    return this.sent ?? this.state.at_s;
  }

  get duration() {
    return this.state?.duration_s || this.state?.at_s || 1;
  }

  /** Select a speed, which may be one that was chosen on the command line. */
  showSpeed(speed) {
    const value = String(speed);
    if (![...this.speed.options].some((option) => option.value === value)) {
      this.speed.append(el("option", { value }, speed === null ? "max" : `×${speed}`));
    }
    this.speed.value = value;
  }

  show() {
    const { state } = this;
    if (this.root.hidden === this.isShown) {
      this.root.hidden = !this.isShown;
      this.marks[this.isShown ? "want" : "release"]();
    }
    if (!state) return;
    setText(this.play, state.paused || state.ended ? "Play" : "Pause");
    if (document.activeElement !== this.speed) this.showSpeed(state.speed);
    if (this.slider.max !== String(this.duration)) {
      this.slider.max = String(this.duration);
      this.draw();
    }
    if (!this.seeks) this.sent = null;
    if (!this.dragging) this.showTime(this.now);
  }

  showTime(at) {
    this.slider.value = String(at);
    const text = `${duration(at)} / ${duration(this.duration)}`;
    setText(this.at, text);
    this.slider.setAttribute("aria-valuetext", text);
  }

  toggle() {
    if (this.isShown)
      this.send(
        this.state.ended && this.state.back ? { paused: false, at_s: 0 } : { paused: !this.state.paused },
      );
  }

  // Goes some seconds on or back. Repeated keys add up before the replay has followed.
  step(seconds) {
    this.seek(this.now + seconds);
  }

  async seek(at) {
    if (!this.isShown) return;
    this.sent = Math.min(Math.max(0, at), this.duration);
    this.showTime(this.sent);
    this.seeks++;
    await this.send({ at_s: this.sent });
    this.seeks--;
  }

  seekSoon(at) {
    this.next = at;
    this.timer ??= setTimeout(() => {
      this.timer = null;
      if (this.dragging && this.state.back) this.send({ at_s: this.next });
    }, SEEK_MS);
  }

  // Jumps to just before the next event, or the one before.
  jump(direction) {
    if (!this.isShown) return;
    const now = this.now + BEFORE_S;
    const times = this.marks.all.map((mark) => mark.t_s);
    const found =
      direction > 0 ? times.filter((at) => at > now + 0.2) : times.filter((at) => at < now - PASSED_S);
    if (found.length)
      this.seek(this.before({ t_s: direction > 0 ? Math.min(...found) : Math.max(...found) }));
    else this.seek(direction > 0 ? this.duration : 0);
  }

  before(mark) {
    return Math.max(0, mark.t_s - BEFORE_S);
  }

  async send(request) {
    setText(this.problem, "");
    try {
      const reply = await fetch("/api/replay", {
        method: "POST",
        headers: { "content-type": "application/json" },
        body: JSON.stringify(request),
      });
      if (!reply.ok) {
        setText(this.problem, (await reply.json()).error);
        this.show();
      }
    } catch {
      /* the server is away: the header says so */
    }
  }

  x(at) {
    return THUMB_PX + (this.canvas.clientWidth - 2 * THUMB_PX) * (at / this.duration);
  }

  timeAt(event) {
    return ((event.offsetX - THUMB_PX) / (this.canvas.clientWidth - 2 * THUMB_PX)) * this.duration;
  }

  markAt(event) {
    return this.marks.near(
      this.timeAt(event),
      (HIT_PX / Math.max(1, this.canvas.clientWidth - 2 * THUMB_PX)) * this.duration,
    );
  }

  point(event) {
    const mark = this.markAt(event);
    this.tip.hidden = false;
    setText(this.tip, mark ? markText(mark) : duration(this.timeAt(event)));
    const maxLeft = this.canvas.clientWidth - this.tip.offsetWidth;
    this.tip.style.left = `${Math.max(0, Math.min(maxLeft, event.offsetX - this.tip.offsetWidth / 2))}px`;
  }

  draw() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width) return;
    const ratio = window.devicePixelRatio || 1;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    const ctx = this.canvas.getContext("2d");
    ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
    for (const [name, { colour, shape }] of Object.entries(KINDS).reverse()) {
      ctx.fillStyle = ctx.strokeStyle = this.theme.colour(colour);
      for (const mark of this.marks.all) {
        if (mark.kind === name)
          drawMark(ctx, shape, this.x(mark.t_s), height * (mark.height ?? 0.5), MARK_PX);
      }
    }
  }
}
