// No-fly zones: the dialog that closes an area, by numbers or drawn on the map; changing and opening one.

/**
 * @import { VerticalLimits } from "../page_types.d.ts"
 * @import { Feed } from "./feed.js"
 * @import { SwarmMap } from "./map.js"
 * @import { Orders } from "./orders.js"
 * @import { Shape } from "./zone_tools.js"
 */

import { openDialog } from "./dialogs.js";
import { el, setText } from "./dom.js";
import { whole } from "./geometry.js";
import { ZoneEdit } from "./zone_edit.js";
import { CircleTool, PolygonTool } from "./zone_tools.js";

const RADIUS_M = 100; // suggested
const NAME = /^[A-Za-z0-9_.-]{1,64}$/;

export class Zones {
  /**
   * @param {SwarmMap} map
   * @param {Feed} feed
   * @param {Orders} orders
   */
  constructor(map, feed, orders) {
    this.map = map;
    this.feed = feed;
    this.orders = orders;
  }

  freeName() {
    const names = new Set(this.feed.data.zones.map((zone) => zone.name));
    let number = 1;
    while (names.has(`zone-${number}`)) number++;
    return `zone-${number}`;
  }

  /**
   * Open the dialog.
   *
   * @param {Shape | null} drawn
   */
  open(drawn = null) {
    const { view } = this.map;
    const circle = drawn?.circle ?? [...whole([view.east, view.north]), RADIUS_M];
    const name = new Field("Name", this.freeName());
    const numbers = ["Centre east, m", "Centre north, m", "Radius, m"].map(
      (label, index) => new Field(label, circle[index]),
    );
    const shown = drawn?.polygon ? [name] : [name, ...numbers];
    const problem = el("div", { class: "problem", role: "alert" });
    const text = drawn?.polygon
      ? `A polygon with ${drawn.polygon.length} corners.`
      : "Routes around the area are planned at once.";
    const close = () => {
      const [east, north, radius] = numbers.map((field) => Number(field.value));
      /** @type {Shape} */
      const shape = drawn?.polygon ? drawn : { circle: [east, north, radius] };
      const mistake = mistakeIn(name.value, shape);
      if (mistake) {
        setText(problem, mistake);
      } else {
        this.send(name.value, shape);
        dialog.close();
      }
    };
    /** @param {typeof CircleTool | typeof PolygonTool} Tool */
    const draw = (Tool) => {
      dialog.close();
      this.map.use(new Tool((shape) => this.drawn(shape)));
    };
    const fields = el("div", { class: "fields" }, ...shown.flatMap((field) => [field.label, field.input]));
    const dialog = openDialog(
      "No-fly zone",
      [el("p", {}, text), fields, problem],
      [
        el("button", { onclick: () => draw(CircleTool) }, "Draw a circle"),
        el("button", { onclick: () => draw(PolygonTool) }, "Draw a polygon"),
        el("button", { onclick: () => dialog.close() }, "Cancel"),
        el("button", { class: "danger", onclick: close }, "Close this area"),
      ],
    );
    name.input.focus();
  }

  /** @param {Shape} shape */
  drawn(shape) {
    this.map.use(null);
    this.open(shape);
  }

  /**
   * Change a zone on the map; the same name with another shape replaces it.
   *
   * @param {string} name
   */
  edit(name) {
    const zone = this.feed.data.zones.find((one) => one.name === name);
    if (!zone) return;
    const [east, north] = zone.disc_m ?? zone.polygon_m[0];
    this.map.motion.show([east, north]);
    /** @param {Shape} shape */
    const send = (shape) => {
      this.send(name, { ...shape, ...heights(zone.limits) });
      this.map.use(null);
    };
    this.map.use(new ZoneEdit(zone, send, () => this.map.use(null)));
  }

  /** @param {string} name */
  reopen(name) {
    this.send(name, {});
  }

  /**
   * @param {string} name
   * @param {(Shape & Partial<VerticalLimits>) | {}} shape without one the zone is opened
   */
  send(name, shape) {
    this.orders.give("no-fly-zone", { no_fly_zone: { name, ...shape } });
  }
}

class Field {
  /**
   * @param {string} label
   * @param {string | number} value
   */
  constructor(label, value) {
    this.label = el("label", {}, label);
    this.input = el("input", { value, "aria-label": label });
  }

  get value() {
    return this.input.value;
  }
}

/**
 * Return what is wrong with a zone; empty for nothing.
 *
 * @param {string} name
 * @param {Shape} shape
 */
export function mistakeIn(name, { circle }) {
  if (!NAME.test(name)) return "Name: letters, digits, _ . - only.";
  if (circle && !(circle.every(Number.isFinite) && circle[2] > 0))
    return "Expected numbers, and a radius above 0.";
  return "";
}

/**
 * Return the heights of a zone as an order has them.
 *
 * @param {VerticalLimits} limits
 */
export function heights(limits) {
  return limits.floor_m === null && limits.ceiling_m === null ? {} : limits;
}
