// Time axis that all charts share.

/** @typedef {[from: number, to: number]} Span in seconds since the start of the run */

const MIN_SPAN_S = 1;
const STEPS_S = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 28800];

/** Dispatches "change" for what is pointed at, and "zoom". */
export class TimeAxis extends EventTarget {
  constructor() {
    super();
    /** End of the run. */
    this.to = 10;
    /** Width of a bin. */
    this.width = 0.5;
    /**
     * Time of the replay.
     *
     * @type {number | null}
     */
    this.now = null;
    /** @type {number | null} */
    this.pointed = null;
    /** @type {Span | null} */
    this.zoomed = null;
    /** Width of the span that ends now and moves on, in a run that goes on; 0: the span stays. */
    this.followed = 0;
    /**
     * Span that the pointer draws.
     *
     * @type {Span | null}
     */
    this.drawn = null;
  }

  /** @returns {Span} */
  get span() {
    return this.zoomed ?? [this.followed && Math.max(0, this.to - this.followed), this.to];
  }

  get isWhole() {
    return !this.zoomed && !this.followed;
  }

  /** The time whose values are written: under the pointer, else now. */
  get read() {
    return this.pointed !== null && this.shows(this.pointed) ? this.pointed : (this.now ?? this.span[1]);
  }

  /** @param {number} at */
  shows(at) {
    return at >= this.span[0] && at <= this.span[1];
  }

  /**
   * Show a span of time, or the whole run.
   *
   * @param {Span | null} span
   * @param {number} followed
   */
  zoom(span, followed = 0) {
    this.drawn = null;
    this.zoomed = span && this.within(span);
    this.followed = followed;
    this.dispatchEvent(new Event("zoom"));
    this.point(this.pointed);
  }

  /**
   * @param {Span} span
   * @returns {Span}
   */
  within(span) {
    const from = Math.max(0, Math.min(...span, this.to - MIN_SPAN_S));
    return [from, Math.min(this.to, Math.max(...span, from + MIN_SPAN_S))];
  }

  /** @param {number | null} at */
  point(at) {
    this.pointed = at;
    this.dispatchEvent(new Event("change"));
  }

  /**
   * Return round times that are at least so far apart.
   *
   * @param {number} apart
   */
  roundTimes(apart) {
    const step = STEPS_S.find((one) => one > apart) ?? STEPS_S[STEPS_S.length - 1];
    const [from, to] = this.span;
    const times = [];
    for (let at = step * Math.ceil(from / step); at <= to; at += step) times.push(at);
    return times;
  }
}
