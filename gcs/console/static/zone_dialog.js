// Dialog that closes an area as a no-fly zone, by numbers or drawn on the map; and changing and opening one.

/**
 * @import { Feed } from "./feed.js"
 * @import { SwarmMap } from "./map.js"
 * @import { Orders } from "./order_sending.js"
 * @import { Texts, ZoneOrder } from "./zone_form.js"
 * @import { Shape } from "./zone_draw_tools.js"
 */

import { openDialog } from "./dialogs.js";
import { el, setText } from "./dom.js";
import { whole } from "./geometry.js";
import { CircleTool, PolygonTool } from "./zone_draw_tools.js";
import { ZoneEdit } from "./zone_edit_tool.js";
import { textsOf, ZoneForm, zoneOf } from "./zone_form.js";

const RADIUS_M = 100; // suggested

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

  /** Open the dialog for a new zone. */
  open() {
    const { view } = this.map;
    const [east, north] = whole([view.east, view.north]);
    this.ask(textsOf(this.freeName(), [east, north, RADIUS_M]));
  }

  /**
   * Open the dialog for a zone; of one that was drawn, or is changed, with its shape.
   *
   * @param {Texts} texts
   * @param {Shape} [shape]
   * @param {boolean} isNew
   */
  ask(texts, shape, isNew = true) {
    const form = new ZoneForm(texts, shape?.polygon, isNew);
    const problem = el("div", { class: "problem", role: "alert" });
    const text = shape?.polygon
      ? `A polygon with ${shape.polygon.length} corners.`
      : "Routes that keep clear of it are planned at once.";
    const close = () => {
      const { zone, mistake } = form.read();
      if (!zone) {
        setText(problem, mistake);
        return;
      }
      this.send(zone);
      dialog.close();
    };
    /** @param {typeof CircleTool | typeof PolygonTool} Tool */
    const draw = (Tool) => {
      const typed = form.typed();
      dialog.close();
      this.map.use(new Tool((drawn) => this.drawn(typed, drawn)));
    };
    const tools = [
      el("button", { onclick: () => draw(CircleTool) }, "Draw a circle"),
      el("button", { onclick: () => draw(PolygonTool) }, "Draw a polygon"),
    ];
    const dialog = openDialog(
      isNew ? "No-fly zone" : `No-fly zone ${texts.name}`,
      [el("p", {}, text), form.element, problem],
      [
        ...(isNew ? tools : []),
        el("button", { onclick: () => dialog.close() }, "Cancel"),
        el("button", { class: "danger", onclick: close }, isNew ? "Close this area" : "Change this area"),
      ],
    );
    form.element.querySelector("input")?.focus();
  }

  /**
   * Open the dialog with a shape that was drawn, and what was typed before.
   *
   * @param {Texts} typed
   * @param {Shape} shape
   */
  drawn(typed, shape) {
    this.map.use(null);
    this.ask(withCircle(typed, shape), shape);
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
    const texts = textsOf(name, undefined, zone.limits);
    const end = () => this.map.use(null);
    /** @param {Shape} shape */
    const send = (shape) => {
      const found = zoneOf(withCircle(texts, shape), shape.polygon);
      if (found.zone) this.send(found.zone);
      else this.orders.say(found.mistake, true);
      end();
    };
    /** @param {Shape} shape */
    const ask = (shape) => {
      end();
      this.ask(withCircle(texts, shape), shape, false);
    };
    this.map.use(new ZoneEdit(zone, send, ask, end));
  }

  /** @param {string} name */
  reopen(name) {
    this.send({ name });
  }

  /** @param {ZoneOrder | { name: string }} zone without a shape it is opened */
  send(zone) {
    this.orders.give("no-fly-zone", { no_fly_zone: zone });
  }
}

/**
 * @param {Texts} texts
 * @param {Shape} shape
 * @returns {Texts}
 */
function withCircle(texts, { circle }) {
  if (!circle) return texts;
  const [east, north, radius] = circle.map(String);
  return { ...texts, east, north, radius };
}
