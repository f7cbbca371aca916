// Motion of the map: what moves or zooms its view, and whether it follows the vehicles.

/**
 * @import { Point } from "../page_types.d.ts"
 * @import { Feed } from "./feed.js"
 * @import { Selection } from "./selection.js"
 */

import { centroid } from "./geometry.js";
import { View } from "./map_view.js";

const SWARM_MARGIN_PX = 60;
const AREA_MARGIN_PX = 24;
/** @type {Point} */
const UNKNOWN_SIZE_M = [1000, 1000];

/** Dispatches "change" after each motion; before it "move", unless the other map of a comparison has moved this one. */
export class MapMotion extends EventTarget {
  /**
   * @param {Feed} feed
   * @param {Selection} selection
   */
  constructor(feed, selection) {
    super();
    this.feed = feed;
    this.selection = selection;
    this.view = new View();
    this.follows = false;
    /** True unless the whole area is shown. */
    this.isMoved = false;
    feed.on("vehicles", () => {
      if (this.follows) this.centreSwarm();
    });
  }

  /**
   * @param {number} dx
   * @param {number} dy
   */
  pan(dx, dy) {
    this.view.pan(dx, dy);
    this.moved();
  }

  /**
   * @param {number} factor
   * @param {number} [x]
   * @param {number} [y]
   */
  zoom(factor, x, y) {
    this.view.zoom(factor, x, y);
    this.moved();
  }

  /**
   * Show what another map shows.
   *
   * @param {number} east
   * @param {number} north
   * @param {number} scale
   */
  look(east, north, scale) {
    this.follows = false;
    this.isMoved = true;
    Object.assign(this.view, { east, north, scale });
    this.dispatchEvent(new Event("change"));
  }

  fitSwarm() {
    const targets = this.selection.ids.size ? [] : this.feed.data.targets.map((one) => one.position_m);
    this.view.fit([...this.places(), ...targets], SWARM_MARGIN_PX);
    this.moved();
  }

  fitArea() {
    this.view.fit([[0, 0], this.feed.data.mission?.size_m ?? UNKNOWN_SIZE_M], AREA_MARGIN_PX);
    this.moved(false);
  }

  toggleFollow() {
    this.follows = !this.follows;
    this.dispatchEvent(new Event("change"));
    this.centreSwarm();
  }

  /**
   * Move the map if a place is out of view.
   *
   * @param {Point} place
   */
  show(place) {
    if (!this.view.shows(place)) this.centre(place);
  }

  centreSwarm() {
    const places = this.places();
    if (places.length) this.centre(centroid(places));
  }

  /** @param {Point} place */
  centre([east, north]) {
    Object.assign(this.view, { east, north });
    this.moved();
  }

  /**
   * Return where the selected vehicles are; without any, all vehicles.
   *
   * @returns {Point[]}
   */
  places() {
    const { vehicles } = this.feed.data;
    const chosen = this.selection.among(vehicles);
    return (chosen.length ? chosen : vehicles).flatMap(({ position_m: at, status }) =>
      at && status !== "lost" ? [at] : [],
    );
  }

  moved(isMoved = true) {
    this.isMoved = isMoved;
    this.dispatchEvent(new Event("move"));
    this.dispatchEvent(new Event("change"));
  }
}
