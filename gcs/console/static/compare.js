// Two recordings side by side: the page of each in a frame, one time line, linked maps, and what differs.

/**
 * @import { AgentRecord, Figures, MissionInfo, Point, ReplayState } from "../page_types.d.ts"
 * @import { Feed, FeedData, Names } from "./feed.js"
 * @import { Actions } from "./keyboard.js"
 * @import { SwarmMap } from "./map.js"
 * @import { Marks } from "./run_marks.js"
 * @import { PlacedMark } from "./replay_bar.js"
 * @import { Selection } from "./selection.js"
 *
 * @typedef {object} Parts what the page in a frame gives
 * @property {Feed} feed
 * @property {SwarmMap} map
 * @property {Marks} marks
 * @property {Selection} selection
 * @property {Actions} actions
 *
 * @typedef {object} Figure
 * @property {string} title
 * @property {(data: FeedData) => number | null | undefined} value
 * @property {number} digits
 */

import { oncePerFrame } from "./canvas.js";
import { showKeys } from "./dialogs.js";
import { el, part, setText } from "./dom.js";
import { duration, number } from "./format.js";
import { toLocal } from "./geodesy.js";
import { KEYS, listenToKeys } from "./keyboard.js";
import { Replay } from "./replay_bar.js";
import { Theme } from "./theme.js";

/** @type {Figure[]} */
const FIGURES = [
  { title: "Agents active", value: agents("active"), digits: 0 },
  { title: "arrived", value: agents("arrived"), digits: 0 },
  { title: "lost", value: agents("lost"), digits: 0 },
  { title: "Targets", value: ({ head, targets }) => head && targets.length, digits: 0 },
  { title: "OSPA agents, m", value: figure("ospa_agents_m"), digits: 1 },
  { title: "OSPA targets, m", value: figure("ospa_targets_m"), digits: 1 },
  { title: "Re-tasks", value: figure("retasks"), digits: 0 },
  { title: "Failed uploads", value: figure("failed_uploads"), digits: 0 },
];

/**
 * @param {AgentRecord["status"]} status
 * @returns {Figure["value"]}
 */
function agents(status) {
  return ({ head, vehicles }) => head && vehicles.filter((one) => one.status === status).length;
}

/**
 * @param {keyof Figures} name
 * @returns {Figure["value"]}
 */
function figure(name) {
  return ({ replay }) => replay?.figures?.[name];
}

class Pane {
  /**
   * @param {string} name
   * @param {string} src
   */
  constructor(name, src) {
    this.name = name;
    this.file = el("span", { class: "file" });
    this.state = el("span", { class: "fair", role: "status" });
    this.frame = el("iframe", { title: `Recording ${name}`, src });
    this.element = el(
      "section",
      { class: "pane", "aria-label": `Recording ${name}` },
      el("h2", {}, el("b", {}, name), this.file, this.state),
      this.frame,
    );
    /**
     * Null until the page in the frame has loaded.
     *
     * @type {Parts | null}
     */
    this.parts = null;
  }

  get mission() {
    return this.parts?.feed.data.mission ?? null;
  }

  show() {
    const { mission, replay } = this.parts?.feed.data ?? {};
    setText(this.file, mission?.title ?? "");
    this.file.title = mission?.title ?? "";
    setText(this.state, replay?.ended ? `ended at ${duration(replay.at_s)}` : "");
  }
}

/** What the replay bar reads, of both recordings: their position, which is the later one, and their marks. */
class Both extends EventTarget {
  /** @param {Pane[]} panes */
  constructor(panes) {
    super();
    this.panes = panes;
    /** @type {PlacedMark[]} */
    this.all = [];
  }

  get data() {
    const states = this.panes.flatMap((pane) => pane.parts?.feed.data.replay ?? []);
    return states.length < this.panes.length ? {} : { replay: joined(states) };
  }

  /**
   * @param {"replay"} _name
   * @param {() => void} callback
   */
  on(_name, callback) {
    this.addEventListener("data", callback);
  }

  /** Nothing to do: the marks of both are wanted from the start. */
  want() {}

  release() {}

  /** Collect the marks of both, in two rows, by time. */
  gather() {
    const found = this.panes.flatMap(({ name, parts }, row) =>
      (parts?.marks.all ?? []).map((mark) => ({
        ...mark,
        text: `${name}: ${mark.text}`,
        height: 0.25 + 0.5 * row,
      })),
    );
    this.all = found.sort((a, b) => a.t_s - b.t_s);
    this.dispatchEvent(new Event("change"));
  }
}

/**
 * Return the state of two replays as one.
 *
 * @param {ReplayState[]} states
 * @returns {ReplayState}
 */
function joined(states) {
  return {
    ...states[0],
    at_s: Math.max(...states.map((one) => one.at_s)),
    duration_s: Math.max(...states.map((one) => one.duration_s ?? one.at_s)),
    ended: states.every((one) => one.ended),
    back: states.every((one) => one.back),
  };
}

/** The pages in the frames look for it in their parent. */
export class Comparison {
  constructor() {
    this.theme = new Theme();
    this.panes = [new Pane("A", "/index.html"), new Pane("B", "/b/")];
    this.both = new Both(this.panes);
    this.replay = new Replay(part("replay"), this.both, this.both, this.theme);
    this.isLinked = true;
    this.hasBegun = false;
    this.showFiguresSoon = oncePerFrame(() => this.showFigures());
    const linked = { title: "A map moves with the other", "aria-pressed": "true" };
    this.linkButton = el("button", { ...linked, onclick: () => this.toggleLink() }, "Link maps");
    part("actions").append(
      this.linkButton,
      el("button", { title: "Dark or light", onclick: () => this.theme.toggle() }, "Theme"),
      el("button", { title: "Keys (?)", onclick: () => showKeys(KEYS) }, "Keys"),
    );
    this.cells = this.table(part("figures"));
  }

  /** @param {HTMLElement} root */
  table(root) {
    /** @param {string} text */
    const head = (text) => el("span", { role: "columnheader" }, text);
    const heads = ["At this time", ...this.panes.map(({ name }) => name), "B − A"].map(head);
    root.append(el("div", { role: "row" }, ...heads));
    return FIGURES.map(({ title }) => {
      const cells = Array.from({ length: 3 }, () => el("span", { role: "cell" }));
      root.append(el("div", { role: "row" }, el("span", { role: "rowheader" }, title), ...cells));
      return cells;
    });
  }

  start() {
    document.querySelector("main")?.append(...this.panes.map(({ element }) => element));
  }

  /**
   * Take the parts of a page that has loaded in a frame.
   *
   * @param {Element | null} frame
   * @param {Parts} parts
   */
  add(frame, parts) {
    const pane = this.panes.find((one) => one.frame === frame);
    if (!pane) return;
    pane.parts = parts;
    parts.map.motion.addEventListener("move", () => this.moveOther(pane));
    parts.marks.addEventListener("change", () => this.both.gather());
    parts.marks.want();
    parts.feed.onData((names) => this.show(pane, names));
    const actions = { ...parts.actions, "?": () => showKeys(KEYS) };
    if (pane === this.panes[0]) listenToKeys(actions, parts.feed, parts.selection);
  }

  /**
   * @param {Pane} pane
   * @param {Names} names
   */
  show(pane, names) {
    pane.show();
    if (this.both.data.replay && names.has("replay")) this.both.dispatchEvent(new Event("data"));
    if (!this.hasBegun && this.panes.every((one) => one.mission)) {
      this.hasBegun = true;
      this.align();
    }
    this.showFiguresSoon();
  }

  showFigures() {
    for (const [index, { value, digits }] of FIGURES.entries()) {
      const [a, b] = this.panes.map(({ parts }) => (parts ? value(parts.feed.data) : null));
      const texts = [number(a, digits), number(b, digits), differenceText(a, b, digits)];
      for (const [column, text] of texts.entries()) setText(this.cells[index][column], text);
    }
  }

  toggleLink() {
    this.isLinked = !this.isLinked;
    this.linkButton.setAttribute("aria-pressed", String(this.isLinked));
    this.align();
  }

  /** Show in both maps the larger part of what the two show. */
  align() {
    const [a, b] = this.panes;
    if (!a.parts || !b.parts) return;
    this.moveOther(a.parts.map.view.scale <= b.parts.map.view.scale ? a : b);
  }

  /** @param {Pane} pane */
  moveOther(pane) {
    const other = this.panes.find((one) => one !== pane);
    if (!this.isLinked || !this.hasBegun || !pane.parts || !other?.parts) return;
    if (!pane.mission || !other.mission) return;
    const [east, north] = offset(pane.mission, other.mission);
    const { view } = pane.parts.map;
    other.parts.map.motion.look(view.east + east, view.north + north, view.scale);
  }
}

/**
 * @param {number | null | undefined} a
 * @param {number | null | undefined} b
 * @param {number} digits
 */
function differenceText(a, b, digits) {
  if (a === null || a === undefined || b === null || b === undefined) return "–";
  const sign = b > a ? "+" : b < a ? "−" : "";
  return sign + number(Math.abs(b - a), digits);
}

/**
 * Return one mission's origin in the frame of another; missions that are far apart are laid over each other.
 *
 * @param {MissionInfo} mission
 * @param {MissionInfo} other
 * @returns {Point}
 */
function offset(mission, other) {
  const place = toLocal(other, ...mission.origin_deg);
  return Math.hypot(...place) < Math.hypot(...other.size_m) ? place : [0, 0];
}

const comparison = new Comparison();
Object.assign(window, { comparison });
comparison.start(); // the frames look for it
