// Height profile of the selected vehicle: ground, flight band, no-fly zones, flown path, route, others.

/**
 * @import { AgentRecord, MissionInfo, Route } from "../page_types.d.ts"
 * @import { Context } from "./canvas.js"
 * @import { Feed } from "./feed.js"
 * @import { SwarmMap } from "./map.js"
 * @import { Panels } from "./panels.js"
 * @import { Other, Station } from "./height_profile_path.js"
 * @import { Crossing } from "./height_profile_zones.js"
 * @import { Selection } from "./selection.js"
 * @import { Theme } from "./theme.js"
 *
 * @typedef {object} Content
 * @property {Station[]} ahead
 * @property {Station[][]} behind runs without a gap
 * @property {Station[]} path behind and ahead
 * @property {{ at: number, height: number }[]} ground
 * @property {Crossing[]} zones
 * @property {Other[]} others
 * @property {Other[]} crossings
 *
 * @typedef {object} Axes
 * @property {(at: number) => number} x
 * @property {(height: number) => number} y
 * @property {[number, number]} span distances that are shown
 * @property {[number, number]} heights
 */

import { contextOf, FAMILY, fit, oncePerFrame, strokeLine } from "./canvas.js";
import { el, setText } from "./dom.js";
import { metres, vehicleName } from "./format.js";
import { roundLength } from "./geometry.js";
import { aheadOf, behindOf, crossingsOf, datumOf, othersNear, stationAt } from "./height_profile_path.js";
import { crossedZones, drawCrossings } from "./height_profile_zones.js";

const ABOUT = "Heights over distance along the path of the vehicle";
const NONE = "Select one vehicle to see the heights of its route.";
const FONT = `11px ${FAMILY}`;
const MIN_HEIGHT = 160;
const [LEFT, RIGHT, TOP, BOTTOM] = [46, 26, 10, 32];
const SAMPLES = 300; // of the ground
const BAND_OPACITY = 0.22;
const MIN_RANGE_M = 60;
const MARGIN = 0.08; // of the heights, above and below
const TICK_PX = 70;
const TICKS = 5;

export class Profile {
  /**
   * @param {HTMLElement} root
   * @param {Feed} feed
   * @param {Selection} selection
   * @param {SwarmMap} map
   * @param {Panels} panels
   * @param {Theme} theme
   */
  constructor(root, feed, selection, map, panels, theme) {
    this.feed = feed;
    this.selection = selection;
    this.map = map;
    this.panels = panels;
    this.theme = theme;
    /** @type {number | null} */
    this.pointedX = null;
    this.title = el("h2");
    this.legend = el("div", { class: "legend" });
    this.values = el("div", { class: "values" });
    this.canvas = el("canvas", { role: "img", "aria-label": ABOUT });
    this.ctx = contextOf(this.canvas);
    this.empty = el("p", { class: "empty" }, NONE);
    this.content = el("div", { class: "content" }, this.title, this.legend, this.values, this.canvas);
    root.append(this.empty, this.content);
    this.redraw = oncePerFrame(() => this.draw());
    feed.onAny(["vehicles", "routes", "mission", "zones"], () => this.redraw());
    for (const source of [selection, panels, theme]) source.addEventListener("change", () => this.redraw());
    this.canvas.addEventListener("pointermove", (event) => this.point(event.offsetX));
    this.canvas.addEventListener("pointerleave", () => this.point(null));
    new ResizeObserver(() => this.redraw()).observe(root);
  }

  /** @param {number | null} x */
  point(x) {
    this.pointedX = x;
    this.redraw();
  }

  draw() {
    if (this.panels.current !== "profile") return;
    const { mission, vehicles } = this.feed.data;
    const chosen = this.selection.among(vehicles);
    const vehicle = chosen.length === 1 ? chosen[0] : undefined;
    const content = mission && vehicle && this.contentOf(mission, vehicle);
    this.content.hidden = !content;
    this.empty.hidden = Boolean(content);
    if (!content) return;
    setText(this.empty, vehicle ? "The position of the vehicle is not known." : NONE);
    setText(this.title, `Vehicle ${vehicleName(vehicle.vehicle)}: ${titleOf(mission, content, vehicle)}`);
    this.showLegend(mission, content);
    const axes = this.axesOf(mission, content);
    this.drawAxes(axes);
    this.drawGround(mission, content, axes);
    drawCrossings(this.ctx, content.zones, axes, this.theme.colour("warning"));
    this.drawPaths(content, axes);
    this.drawOthers(content, axes);
    this.showValues(mission, content, axes);
  }

  /**
   * Return what is drawn; null before the first position.
   *
   * @param {MissionInfo} mission
   * @param {AgentRecord} vehicle
   * @returns {Content | null}
   */
  contentOf(mission, vehicle) {
    const { vehicles, routes, proposal, zones } = this.feed.data;
    /** @type {(id: number) => Route | undefined} */
    const routeOf = (id) => [...routes, ...(proposal?.routes ?? [])].find((one) => one.vehicle === id);
    const ahead = aheadOf(mission, vehicle, routeOf(vehicle.vehicle));
    if (!ahead.length) return null;
    const datum = datumOf(mission, vehicle);
    const trail = this.map.picture.trails.trails.get(vehicle.vehicle) ?? [];
    const behind = behindOf(trail, ahead[0], datum, ahead[ahead.length - 1].at);
    const path = [...behind.flat(), ...ahead.slice(1)];
    const others = vehicles.filter((one) => one.vehicle !== vehicle.vehicle && one.status !== "lost");
    return {
      ahead,
      behind,
      path,
      ground: this.groundUnder(path),
      zones: crossedZones(
        path,
        zones,
        mission,
        (place) => this.map.picture.terrain.ground?.at(place) ?? null,
      ),
      others: othersNear(path, others, datum),
      crossings: others.flatMap((one) => {
        const shift = datumOf(mission, one) - datum;
        const other = aheadOf(mission, one, routeOf(one.vehicle));
        return crossingsOf(ahead, one.vehicle, other).map((at) => ({ ...at, height: at.height + shift }));
      }),
    };
  }

  /** @param {Station[]} path */
  groundUnder(path) {
    const { ground } = this.map.picture.terrain;
    if (!ground) return [];
    const [from, to] = [path[0].at, path[path.length - 1].at];
    return Array.from({ length: SAMPLES + 1 }, (_, index) => {
      const at = from + (index / SAMPLES) * (to - from);
      return { at, height: ground.at(stationAt(path, at).place) };
    }).flatMap(({ at, height }) => (height === null ? [] : [{ at, height }]));
  }

  /**
   * @param {MissionInfo} mission
   * @param {Content} content
   * @returns {Axes}
   */
  axesOf({ elevation }, { path, ground, zones, others, crossings }) {
    const { ctx } = this;
    const width = this.canvas.clientWidth;
    const height = Math.max(MIN_HEIGHT, this.canvas.clientHeight);
    fit(ctx, width, height);
    const shown = [...path, ...others, ...crossings].map((one) => one.height);
    const ceilings = elevation ? ground.map((one) => one.height + elevation.max_agl_m) : [];
    const least = Math.min(elevation ? Infinity : 0, ...shown, ...ground.map((one) => one.height));
    const most = Math.max(least + MIN_RANGE_M, ...shown, ...ceilings);
    const edges = zones.flatMap((zone) => zone.edges.flatMap((one) => [one.floor, one.ceiling]));
    const near = edges.filter((one) => one > least && one < 2 * most - least);
    const [lowest, highest] = [least, Math.max(most, ...near)];
    const margin = MARGIN * (highest - lowest);
    const [bottom, top] = [lowest - margin, highest + margin];
    const [from, to] = [path[0].at, Math.max(path[path.length - 1].at, path[0].at + 1)];
    return {
      x: (at) => LEFT + ((at - from) / (to - from)) * (width - LEFT - RIGHT),
      y: (value) => TOP + ((top - value) / (top - bottom)) * (height - TOP - BOTTOM),
      span: [from, to],
      heights: [bottom, top],
    };
  }

  /** @param {Axes} axes */
  drawAxes({ x, y, span: [from, to], heights: [bottom, top] }) {
    const { ctx, theme } = this;
    const [left, right, down] = [x(from), x(to), y(bottom)];
    ctx.font = FONT;
    ctx.lineWidth = 1;
    ctx.strokeStyle = theme.colour("grid");
    ctx.fillStyle = theme.colour("dim");
    ctx.textAlign = "right";
    const step = roundLength((top - bottom) / TICKS);
    for (let value = Math.ceil(bottom / step) * step; value < top; value += step) {
      strokeLine(ctx, [
        [left, y(value)],
        [right, y(value)],
      ]);
      ctx.fillText(value.toFixed(0), left - 5, y(value) + 4);
    }
    ctx.textAlign = "center";
    const stride = roundLength(((to - from) * TICK_PX) / Math.max(1, right - left));
    for (let at = Math.ceil(from / stride) * stride; at <= to; at += stride) {
      strokeLine(ctx, [
        [x(at), down],
        [x(at), down + 4],
      ]);
      if (at === 0 || Math.abs(x(at) - x(0)) > TICK_PX / 2) ctx.fillText(distanceText(at), x(at), down + 15);
    }
    ctx.fillText("distance along the path", (left + right) / 2, down + 28);
  }

  /**
   * @param {MissionInfo} mission
   * @param {Content} content
   * @param {Axes} axes
   */
  drawGround({ elevation }, { ground }, { x, y, heights: [bottom] }) {
    if (!elevation || !ground.length) return;
    const { ctx, theme } = this;
    /** @type {(agl: number) => [number, number][]} */
    const surface = (agl) => ground.map(({ at, height }) => [x(at), y(height + agl)]);
    const [floor, ceiling] = [surface(elevation.min_agl_m), surface(elevation.max_agl_m)];
    const ends = [x(ground[0].at), x(ground[ground.length - 1].at)];
    fillShape(
      ctx,
      [...surface(0), [ends[1], y(bottom)], [ends[0], y(bottom)]],
      theme.colour("profile-ground"),
    );
    ctx.globalAlpha = BAND_OPACITY;
    fillShape(ctx, [...floor, ...ceiling.reverse()], theme.colour("done"));
    ctx.globalAlpha = 1;
    ctx.strokeStyle = theme.colour("done");
    ctx.lineWidth = 1;
    strokeLine(ctx, floor);
    ctx.setLineDash([4, 3]);
    strokeLine(ctx, ceiling);
    ctx.setLineDash([]);
  }

  /**
   * @param {Content} content
   * @param {Axes} axes
   */
  drawPaths({ ahead, behind }, { x, y, heights: [bottom, top] }) {
    const { ctx, theme } = this;
    /** @type {(one: Station) => [number, number]} */
    const pixel = (one) => [x(one.at), y(one.height)];
    ctx.strokeStyle = theme.colour("dim");
    ctx.lineWidth = 1;
    ctx.setLineDash([2, 3]);
    strokeLine(ctx, [
      [x(0), y(bottom)],
      [x(0), y(top)],
    ]);
    ctx.strokeStyle = ctx.fillStyle = theme.colour("route");
    ctx.lineWidth = 2;
    ctx.setLineDash([7, 4]);
    strokeLine(ctx, ahead.map(pixel));
    ctx.setLineDash([]);
    for (const [left, down] of ahead.slice(1).map(pixel)) ctx.fillRect(left - 2.5, down - 2.5, 5, 5);
    ctx.strokeStyle = ctx.fillStyle = theme.colour("vehicle");
    for (const run of behind) strokeLine(ctx, run.map(pixel));
    const [left, down] = pixel(ahead[0]);
    fillShape(
      ctx,
      [
        [left + 8, down],
        [left - 5, down - 5],
        [left - 5, down + 5],
      ],
      theme.colour("vehicle"),
    );
  }

  /**
   * @param {Content} content
   * @param {Axes} axes
   */
  drawOthers({ others, crossings }, { x, y }) {
    const { ctx, theme } = this;
    ctx.textAlign = "left";
    ctx.lineWidth = 1.5;
    ctx.strokeStyle = ctx.fillStyle = theme.colour("caution");
    for (const { vehicle, at, height } of others) {
      ctx.beginPath();
      ctx.arc(x(at), y(height), 4, 0, 2 * Math.PI);
      ctx.fill();
      ctx.fillText(vehicleName(vehicle), x(at) + 7, y(height) - 4);
    }
    for (const { vehicle, at, height } of crossings) {
      const [left, down] = [x(at), y(height)];
      for (const side of [-4, 4]) {
        strokeLine(ctx, [
          [left - 4, down - side],
          [left + 4, down + side],
        ]);
      }
      ctx.fillText(vehicleName(vehicle), left + 7, down + 11);
    }
  }

  /**
   * @param {MissionInfo} mission
   * @param {Content} content
   */
  showLegend({ elevation }, { ahead, zones, others, crossings }) {
    const band = elevation && `flight band, ${elevation.min_agl_m} to ${elevation.max_agl_m} m above ground`;
    const entries = [
      ["vehicle", "━", "flown"],
      ahead.length > 1 && ["route", "╍", "planned route"],
      elevation && ["profile-ground", "■", "ground"],
      band && ["done", "▒", band],
      zones.length && ["warning", "▒", "no-fly zones"],
      others.length && ["caution", "●", "other vehicles within 300 m, now"],
      crossings.length && ["caution", "✕", "routes that cross"],
    ];
    const key = JSON.stringify(entries);
    if (this.legend.dataset.key === key) return;
    this.legend.dataset.key = key;
    this.legend.replaceChildren(
      ...entries.flatMap((entry) => {
        if (!entry) return [];
        const sign = el("span", { class: `sign ${entry[0]}`, "aria-hidden": "true" }, entry[1]);
        return [el("span", {}, sign, entry[2])];
      }),
    );
  }

  /**
   * Write the heights under the pointer, else those of now.
   *
   * @param {MissionInfo} mission
   * @param {Content} content
   * @param {Axes} axes
   */
  showValues({ elevation }, { path, ahead }, { x, y, span: [from, to], heights: [bottom, top] }) {
    const share = this.pointedX === null ? 0 : (this.pointedX - x(from)) / Math.max(1, x(to) - x(from));
    const at = this.pointedX === null ? 0 : from + Math.min(1, Math.max(0, share)) * (to - from);
    const station = at === 0 ? ahead[0] : stationAt(path, at);
    const ground = this.map.picture.terrain.ground?.at(station.place) ?? null;
    const parts = [at === 0 ? "now" : `${metres(Math.abs(at))} ${at < 0 ? "behind" : "ahead"}`];
    parts.push(`${station.height.toFixed(0)} m ${elevation ? "above sea level" : "above home"}`);
    if (ground !== null) {
      parts.push(`${(station.height - ground).toFixed(0)} m above ground`, `ground ${ground.toFixed(0)} m`);
    }
    setText(this.values, parts.join(" · "));
    if (this.pointedX === null) return;
    this.ctx.strokeStyle = this.theme.colour("advisory");
    this.ctx.lineWidth = 1;
    strokeLine(this.ctx, [
      [x(at), y(bottom)],
      [x(at), y(top)],
    ]);
  }
}

/**
 * @param {MissionInfo} mission
 * @param {Content} content
 * @param {AgentRecord} vehicle
 */
function titleOf({ elevation }, { ahead }, { layer }) {
  if (elevation) return "height above sea level, m";
  return ahead.length > 1 ? `height above home, m; flat; layer ${layer}` : "height above home, m; flat";
}

/** @param {number} at */
function distanceText(at) {
  if (at === 0) return "now";
  return Math.abs(at) < 10_000 ? `${at} m` : `${at / 1000} km`;
}

/**
 * @param {Context} ctx
 * @param {[x: number, y: number][]} points
 * @param {string} tint
 */
function fillShape(ctx, points, tint) {
  ctx.fillStyle = tint;
  ctx.beginPath();
  for (const [x, y] of points) ctx.lineTo(x, y);
  ctx.fill();
}
