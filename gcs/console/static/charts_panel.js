// Panel with the charts of the run: which there are, and their data, which is fetched only while it is open.

/**
 * @import { ChartsReply, Kind, Series } from "../page_types.d.ts"
 * @import { Shared } from "./time_chart.js"
 * @import { Feed } from "./feed.js"
 * @import { Line } from "./line_chart.js"
 * @import { Marks } from "./run_marks.js"
 * @import { Panels } from "./panels.js"
 * @import { Selection } from "./selection.js"
 * @import { Theme } from "./theme.js"
 */

import { oncePerFrame } from "./canvas.js";
import { el } from "./dom.js";
import { vehicleName } from "./format.js";
import { LineChart } from "./line_chart.js";
import { MarkChart } from "./mark_chart.js";
import { RowChart } from "./row_chart.js";
import { TimeAxis } from "./time_axis.js";

const POLL_MS = 2000;
const AROUND_S = 30;
const MIN_END_S = 10;
const MAX_LINES = 8; // with more vehicles, only the selected ones are named
const COLOURS = ["series-1", "series-2", "series-3", "series-4", "series-5", "series-6"];
const DASHES = [[], [6, 3], [2, 2]];
/** @type {{ kind: Kind, colour: string, dash: number[] }[]} */
const KINDS = [
  { kind: "agents", colour: "vehicle", dash: [] },
  { kind: "targets", colour: "target", dash: [6, 3] },
];
/** @type {{ kind: "scan" | "plan", name: string, colour: string, dash: number[] }[]} */
const WORKS = [
  { kind: "scan", name: "step with a scan", colour: "series-1", dash: [] },
  { kind: "plan", name: "step with a plan", colour: "series-2", dash: [6, 3] },
];

export class Charts {
  /**
   * @param {HTMLElement} root
   * @param {Feed} feed
   * @param {Marks} marks
   * @param {Selection} selection
   * @param {Theme} theme
   * @param {Panels} panels
   * @param {(at: number) => void} seek
   */
  constructor(root, feed, marks, selection, theme, panels, seek) {
    this.feed = feed;
    this.marks = marks;
    this.selection = selection;
    this.panels = panels;
    this.wasOpen = false;
    this.isWaiting = false;
    /** @type {ChartsReply | null} */
    this.data = null;
    this.axis = new TimeAxis();
    /** @type {Shared} */
    const shared = {
      root,
      axis: this.axis,
      theme,
      seek: (at) => {
        if (feed.data.mission?.kind === "replay") seek(at);
      },
    };
    root.append(this.head());
    this.events = new MarkChart(shared, "Events");
    this.objects = new LineChart(shared, "Number of objects (± 1σ)", { digits: 1 });
    this.ospa = new LineChart(shared, "OSPA of positions (c = 100 m, p = 1), m", { digits: 1 });
    this.rate = new LineChart(shared, "Messages received, 1/s", { digits: 1 });
    this.loss = new LineChart(shared, "Messages lost, %", { digits: 1 });
    this.battery = new LineChart(shared, "Battery, %", { least: 100 });
    const work = "Longest computing time (in a replay: of what was played), ms";
    this.work = new LineChart(shared, work, { digits: 1 });
    this.targets = new RowChart(shared, "Existence probability of target tracks");
    this.agents = new RowChart(shared, "Existence probability of agent tracks");
    const lines = [this.objects, this.ospa, this.rate, this.loss, this.battery, this.work];
    this.charts = [this.events, ...lines, this.targets, this.agents];
    this.redraw = oncePerFrame(() => {
      for (const chart of this.charts) chart.draw();
    });
    feed.onAny(["replay", "head"], () => this.showTime());
    marks.addEventListener("change", () => this.showMarks());
    selection.addEventListener("change", () => this.show());
    theme.addEventListener("change", () => this.draw());
    panels.addEventListener("change", () => this.changed());
    new ResizeObserver(() => this.draw()).observe(root);
  }

  head() {
    const { axis, panels } = this;
    const whole = el(
      "button",
      { hidden: true, onclick: () => axis.zoom(null) },
      "Whole run",
      el("kbd", {}, "W"),
    );
    axis.addEventListener("zoom", () => {
      whole.hidden = axis.isWhole;
    });
    const close = el(
      "button",
      { "aria-label": "Close the charts", onclick: () => panels.toggle("charts") },
      "Close",
      el("kbd", {}, "G"),
    );
    return el("h2", {}, "Charts", el("span", { class: "space" }), whole, close);
  }

  get isOpen() {
    return this.panels.current === "charts";
  }

  changed() {
    if (this.isOpen === this.wasOpen) return;
    this.wasOpen = this.isOpen;
    if (this.isOpen) {
      this.marks.want();
      this.load();
    } else {
      this.marks.release();
    }
  }

  /** Show a minute around the time of the replay, or always the last one; then the whole run again. */
  zoom() {
    const { axis } = this;
    if (!this.isOpen) return;
    if (!axis.isWhole) axis.zoom(null);
    else if (axis.now === null) axis.zoom(null, 2 * AROUND_S);
    else {
      const at = Math.min(axis.now, axis.to - AROUND_S);
      axis.zoom([at - AROUND_S, at + AROUND_S]);
    }
  }

  async load() {
    if (!this.isOpen || this.isWaiting) return;
    this.isWaiting = true;
    try {
      const reply = await fetch("api/charts");
      this.data = await reply.json();
      this.show();
    } catch {
      // The server is away: the header says so.
    }
    setTimeout(() => {
      this.isWaiting = false;
      this.load();
    }, POLL_MS);
  }

  showTime() {
    const { replay, head } = this.feed.data;
    const now = replay ? replay.at_s : null;
    const to = Math.max(MIN_END_S, replay?.duration_s ?? head?.elapsed_s ?? 0);
    if (now === this.axis.now && to === this.axis.to) return;
    Object.assign(this.axis, { now, to });
    this.draw();
  }

  showMarks() {
    if (this.isOpen) this.events.show(this.marks.all);
  }

  draw() {
    if (this.isOpen) this.redraw();
  }

  show() {
    const { data } = this;
    if (!this.isOpen || !data) return;
    this.axis.width = data.width_s;
    this.showMarks();
    this.objects.show(objectLines(data));
    this.ospa.show(lines(KINDS, data.ospa));
    this.targets.show(trackRows(data.existence.targets ?? {}, "target"));
    this.agents.show(trackRows(data.existence.agents ?? {}, "vehicle"));
    this.rate.show(this.vehicleLines(data.rate));
    this.loss.show(this.vehicleLines(data.loss));
    this.battery.show(this.vehicleLines(data.battery));
    this.work.show(lines(WORKS, data.work));
  }

  /**
   * Return the lines of vehicles, selected ones on top. Colours and dashes go by number, so that they stay.
   *
   * @param {Record<string, Series>} values
   */
  vehicleLines(values) {
    const chosen = new Set(
      this.selection.among(this.feed.data.vehicles).map((one) => vehicleName(one.vehicle)),
    );
    const names = Object.keys(values).sort((a, b) => Number(a) - Number(b));
    const hasChosen = names.some((name) => chosen.has(name));
    const found = names.map((name, index) => {
      const isNamed = hasChosen ? chosen.has(name) : names.length <= MAX_LINES;
      return {
        name: `vehicle ${name}`,
        values: values[name],
        colour: COLOURS[index % COLOURS.length],
        dash: DASHES[Math.floor(index / COLOURS.length) % DASHES.length],
        tag: isNamed ? name : "",
        isFaint: !isNamed,
      };
    });
    return [...found.filter((line) => line.isFaint), ...found.filter((line) => !line.isFaint)];
  }
}

/**
 * Return the lines of the numbers of objects, each true one below the estimated one.
 *
 * @param {ChartsReply} data
 */
function objectLines(data) {
  /** @type {Line[]} */
  const found = [];
  for (const { kind, colour, dash } of KINDS) {
    const truth = data.true[kind];
    const values = data.objects[kind];
    if (truth) found.push({ name: `${kind}, true`, values: truth, colour, isWide: true });
    if (values) found.push({ name: kind, values, spread: data.spread[kind], colour, dash });
  }
  return found;
}

/**
 * @template {string} Kind
 * @param {{ kind: Kind, name?: string, colour: string, dash: number[] }[]} styles
 * @param {Partial<Record<Kind, Series>>} series
 * @returns {Line[]}
 */
function lines(styles, series) {
  return styles.flatMap(({ kind, name = kind, colour, dash }) => {
    const values = series[kind];
    return values ? [{ name, values, colour, dash }] : [];
  });
}

/**
 * @param {Record<string, Series>} series
 * @param {string} colour
 */
function trackRows(series, colour) {
  return Object.entries(series).map(([name, values]) => ({ name, values, colour }));
}
