// Map: its elements, its tools, and when it is drawn.

/**
 * @import { MissionDetail, Point } from "../page_types.d.ts"
 * @import { Colour, Context } from "./canvas.js"
 * @import { Feed } from "./feed.js"
 * @import { Selection } from "./selection.js"
 * @import { Theme } from "./theme.js"
 * @import { View } from "./map_view.js"
 *
 * @typedef {object} Tool takes the pointer until it ends
 * @property {string} hint
 * @property {[label: string, act: () => void][]} [actions]
 * @property {(place: Point) => void} [click]
 * @property {(place: Point) => void} [hover]
 * @property {(place: Point) => boolean} [down] begins a drag; returns false if the map shall be dragged
 * @property {(place: Point) => void} [drag]
 * @property {() => void} [up] ends a drag
 * @property {(ctx: Context, view: View, colour: Colour) => void} draw
 */

import { contextOf, fit, oncePerFrame } from "./canvas.js";
import { el } from "./dom.js";
import { drawScaleBar } from "./draw_ground.js";
import { MapLayers } from "./map_layers.js";
import { MapMotion } from "./map_motion.js";
import { MapPicture } from "./map_picture.js";
import { Pointer } from "./map_pointer.js";
import { Measure } from "./measure_tool.js";

const FADE_STEP_MS = 250;
const ABOUT = "Map of vehicles, targets and routes; the tables have the same data";

export class SwarmMap {
  /**
   * @param {HTMLElement} root
   * @param {Feed} feed
   * @param {Selection} selection
   * @param {Theme} theme
   */
  constructor(root, feed, selection, theme) {
    this.feed = feed;
    this.theme = theme;
    this.motion = new MapMotion(feed, selection);
    this.view = this.motion.view;
    this.layers = new MapLayers();
    /** @type {Tool | null} */
    this.tool = null;
    this.run = "";
    this.isSized = false;
    this.isFading = false;
    this.redraw = oncePerFrame(() => this.draw());
    this.canvas = el("canvas", { role: "img", "aria-label": ABOUT });
    this.ctx = contextOf(this.canvas, { alpha: false });
    this.picture = new MapPicture(this.ctx, this.view, selection, theme, this.redraw);
    this.hint = el("div", { class: "hint", hidden: true });
    const followed = "Keep the selected vehicles, or the swarm, in view";
    this.followButton = button("Follow", "F", followed, () => this.motion.toggleFollow());
    this.layersButton = button("Layers", "L", "Choose what is drawn", (event) => this.toggleLayers(event));
    const place = el("div", { class: "place" });
    root.append(this.canvas, this.tools(), this.layers.panel, this.hint, place);
    this.pointer = new Pointer(this, place, feed, selection);
    selection.addEventListener("change", () => this.redraw());
    this.listen();
  }

  tools() {
    return el(
      "div",
      { class: "tools" },
      button("+", "+", "Zoom in", () => this.motion.zoom(1.4)),
      button("−", "-", "Zoom out", () => this.motion.zoom(1 / 1.4)),
      button("Swarm", "Z", "Zoom to the swarm", () => this.motion.fitSwarm()),
      button("All", "0", "Zoom to the mission's area", () => this.motion.fitArea()),
      this.followButton,
      this.layersButton,
      button("Measure", "M", "Measure a distance", () => this.measure()),
    );
  }

  listen() {
    const { feed, motion, picture, theme } = this;
    new ResizeObserver(() => this.resize()).observe(this.canvas);
    theme.addEventListener("change", () => {
      picture.obstacles.recolour(theme.colour);
      picture.terrain.recolour(theme.colour);
      this.redraw();
    });
    this.layers.addEventListener("change", () => this.redraw());
    motion.addEventListener("change", () => {
      this.followButton.setAttribute("aria-pressed", String(motion.follows));
      this.redraw();
    });
    feed.on("mission", (mission) => {
      picture.terrain.set(mission.elevation, theme.colour);
      this.layers.setLag(mission.lag_scans);
    });
    feed.on("map", (map) => picture.obstacles.set(map, theme.colour));
    feed.on("vehicles", (vehicles) => picture.trails.add(vehicles));
    feed.on("late", (late, isFresh) => {
      if (!isFresh) picture.late.add(late);
    });
    feed.on("scans", (scans) => picture.detections.add(scans));
    feed.onData((_, isFresh) => {
      if (isFresh) this.begin();
      this.redraw();
    });
  }

  begin() {
    const { mission, trails, late } = this.feed.data;
    this.picture.detections.clear();
    this.picture.trails.begin(trails);
    this.picture.late.begin(late ?? {});
    const run = `${mission?.name} ${mission?.begun}`;
    if (run === this.run) return;
    this.run = run;
    this.motion.fitArea();
  }

  /**
   * Let a tool take the pointer, or end it.
   *
   * @param {Tool | null} tool
   */
  use(tool) {
    this.tool = tool;
    const actions = (tool?.actions ?? []).map(([label, act]) => el("button", { onclick: act }, label));
    this.hint.replaceChildren(tool?.hint ?? "", ...actions);
    this.hint.hidden = !tool;
    actions[0]?.focus();
    this.redraw();
  }

  /** Begin to measure, or end the tool. */
  measure() {
    this.use(this.tool ? null : new Measure());
  }

  /**
   * Show the onboard mission of the vehicle whose details are shown.
   *
   * @param {MissionDetail | null} mission
   */
  setMission(mission) {
    this.picture.onboard = mission;
    this.redraw();
  }

  /** @param {MouseEvent} [event] of a click; one by a key has no detail */
  toggleLayers(event) {
    this.layersButton.setAttribute("aria-pressed", String(this.layers.toggle(!event?.detail)));
  }

  /** End the tool, or close the layers; return false if there was neither. */
  escape() {
    if (this.tool) this.use(null);
    else if (!this.layers.panel.hidden) this.toggleLayers();
    else return false;
    return true;
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    fit(this.ctx, width, height);
    Object.assign(this.view, { width, height });
    this.isSized = true;
    if (!this.motion.isMoved && this.feed.data.mission) this.motion.fitArea();
    this.draw();
  }

  draw() {
    const { ctx, view, layers, picture } = this;
    const { colour } = this.theme;
    const { mission } = this.feed.data;
    if (!mission || !this.isSized) return;
    picture.draw(this.feed.data, mission, layers.shown);
    this.tool?.draw(ctx, view, colour);
    this.pointer.drawBox(ctx, colour);
    drawScaleBar(ctx, view, colour, layers.shown.terrain ? picture.terrain.legend : "");
    if (layers.shown.detections && !picture.detections.isEmpty) this.fade();
  }

  /** Draw again while detections fade. */
  fade() {
    if (this.isFading) return;
    this.isFading = true;
    setTimeout(() => {
      this.isFading = false;
      this.redraw();
    }, FADE_STEP_MS);
  }
}

/**
 * @param {string} text
 * @param {string} key
 * @param {string} title
 * @param {(event: MouseEvent) => void} action
 */
function button(text, key, title, action) {
  return el("button", { title: `${title} (${key})`, onclick: action }, text);
}
