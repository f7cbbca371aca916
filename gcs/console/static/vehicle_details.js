// Panel with the details of one vehicle: everything of its record, and its onboard mission.

/**
 * @import { MissionDetail, VehicleDetail } from "../page_types.d.ts"
 * @import { Feed } from "./feed.js"
 * @import { SwarmMap } from "./map.js"
 * @import { Panels } from "./panels.js"
 * @import { Selection } from "./selection.js"
 */

import { el, setText, tableOf } from "./dom.js";
import { duration, number, seconds, targetName, vehicleName } from "./format.js";
import { FrameRate } from "./frame_rate.js";

const PERIOD_MS = 1000;
/** @type {[string, string][]} */
const HEADS = [
  ["item", "left"],
  ["command", "left"],
  ["east", ""],
  ["north", ""],
  ["alt m", ""],
  ["above", "left"],
];

/** @param {string} text */
const bad = (text) => el("span", { class: "bad" }, text);
/** @param {string} text */
const fair = (text) => el("span", { class: "fair" }, text);

export class Detail {
  /**
   * @param {HTMLElement} root
   * @param {Feed} feed
   * @param {Selection} selection
   * @param {SwarmMap} map
   * @param {Panels} panels
   */
  constructor(root, feed, selection, map, panels) {
    this.feed = feed;
    this.selection = selection;
    this.map = map;
    this.panels = panels;
    /** @type {VehicleDetail | null} */
    this.record = null;
    this.rate = new FrameRate();
    this.title = el("h2");
    this.list = el("dl");
    this.items = el("tbody");
    this.table = tableOf(HEADS, this.items, { class: "dense" });
    this.empty = el("p", { class: "empty" }, "Select one vehicle to see all that is known of it.");
    this.content = el("div", {}, this.title, this.list, this.table);
    root.append(this.empty, this.content);
    selection.addEventListener("change", () => {
      panels.follow(selection.ids.size === 1);
      this.begin();
    });
    panels.addEventListener("change", () => this.begin());
    feed.onData((_, isFresh) => {
      if (isFresh) this.load();
    });
    setInterval(() => this.load(), PERIOD_MS);
    this.show();
  }

  /** The vehicle whose details are shown. */
  get vehicle() {
    if (this.panels.current !== "detail" || this.selection.ids.size !== 1) return undefined;
    return this.selection.among(this.feed.data.vehicles)[0];
  }

  begin() {
    if (this.record?.agent.vehicle !== this.vehicle?.vehicle) this.keep(null);
    this.load();
  }

  /** @param {VehicleDetail | null} record */
  keep(record) {
    this.rate.add(record);
    this.record = record;
    this.map.setMission(record?.mission ?? null);
    this.show();
  }

  async load() {
    const { vehicle } = this;
    if (!vehicle) {
      if (this.record) this.keep(null);
      return;
    }
    const record = await fetchDetail(vehicleName(vehicle.vehicle));
    if (record && record.agent.vehicle === this.vehicle?.vehicle) this.keep(record);
  }

  show() {
    const { record } = this;
    this.content.hidden = !record;
    this.empty.hidden = Boolean(record);
    if (!record) return;
    setText(this.title, `Vehicle ${vehicleName(record.agent.vehicle)}`);
    this.list.replaceChildren(
      ...row("authority", authorityOf(record)),
      ...row("link", linkOf(record, this.rate.perSecond)),
      ...row("mission", missionOf(record)),
      ...row("upload", uploadOf(record)),
      ...row("pinned to", [record.agent.pinned ? targetName(record.agent.pinned) : "no target"]),
      ...row("height", [heightOf(record, this.feed.data.mission?.terrain === "flat")]),
      ...row("return", returnOf(record)),
      ...row("position", positionOf(record)),
    );
    const problem = record.takeoff_problem;
    if (problem) this.list.append(...row("take-off", [bad(`not clear: ${problem}`)]));
    this.table.hidden = !record.mission;
    if (record.mission) this.items.replaceChildren(...itemRows(record.mission));
  }
}

/**
 * Return the record of a vehicle; null without a connection: the header says so, and the record that is shown
 * stays.
 *
 * @param {string} name
 * @returns {Promise<VehicleDetail | null>}
 */
async function fetchDetail(name) {
  const signal = AbortSignal.timeout(3 * PERIOD_MS);
  try {
    const reply = await fetch(`api/vehicles/${encodeURIComponent(name)}`, { signal });
    return reply.ok ? await reply.json() : null;
  } catch {
    return null;
  }
}

/**
 * @param {string} name
 * @param {(Node | string)[]} parts
 */
function row(name, parts) {
  return [el("dt", {}, name), el("dd", {}, ...parts)];
}

/** @param {VehicleDetail} record */
function authorityOf({ claims }) {
  if (!claims.length) return ["ours"];
  return claims.map(({ authority, reason, since_s: since }, index) => {
    const style = index || authority === "ours" ? "" : "fair";
    return el("div", { class: style }, `${authority} for ${duration(since)}: ${reason}`);
  });
}

/**
 * @param {VehicleDetail} record
 * @param {number | null} framesPerSecond
 */
function linkOf({ link }, framesPerSecond) {
  if (!link.address) return [bad("never heard")];
  const signed = link.signed ? "signed" : "not signed";
  const lost = `${link.lost} of ${link.frames + link.lost} lost`;
  const parts = [
    link.state === "alive" ? "heard" : bad(link.state),
    ` at ${link.address}, ${number(framesPerSecond)} frames/s, ${lost}, `,
    `${signed}, ${link.autopilot || "unknown firmware"}`,
  ];
  if (link.conflicts) parts.push(bad(`, ${link.conflicts} frames from another address`));
  if (link.reboots) parts.push(fair(`, ${link.reboots} reboots`));
  return parts;
}

/** @param {VehicleDetail} record */
function missionOf({ mission }) {
  if (!mission) return [fair("unknown")];
  const { items, target, verified_s: verified } = mission;
  const since = verified === null ? "" : ` ${duration(verified)} ago`;
  /** @type {(Node | string)[]} */
  const parts = [`${items.length} items to ${targetName(target)}, verified${since}`];
  if (mission.audited) parts.push(fair(", being audited"));
  if (mission.inconsistent) parts.push(bad(", may be inconsistent"));
  return parts;
}

/** @param {VehicleDetail} record */
function uploadOf({ agent: { upload: stage }, upload: { since_s: since, failures, pause_s: pause } }) {
  const time = since === null ? "" : ` for ${seconds(since)}`;
  /** @type {(Node | string)[]} */
  const parts = [stage ? stage + time : "none"];
  if (failures) parts.push(bad(`, ${failures} failed`));
  if (pause) parts.push(fair(`, next attempt in ${seconds(pause)}`));
  return parts;
}

/**
 * @param {VehicleDetail} record
 * @param {boolean} isFlat
 */
function heightOf({ agent: { alt_rel_m: rel, alt_msl_m: msl, agl_m: agl } }, isFlat) {
  const heights = `${number(rel)} m above home, ${number(msl)} m above sea level`;
  return isFlat ? heights : `${number(agl)} m above ground, ${heights}`;
}

/** @param {VehicleDetail} record */
function returnOf({ return: { height, problem } }) {
  /** @type {(Node | string)[]} */
  const parts = [height || "height not known: run gcs preflight"];
  if (problem) parts.push(fair(`, ${problem}`));
  return parts;
}

/** @param {VehicleDetail} record */
function positionOf({ agent, position: { cusum, alarm_cusum: limit, refused } }) {
  const parts = [
    agent.is_position_doubted ? bad("doubted") : "consistent with the sensors",
    `, CUSUM ${number(cusum, 1)} of ${limit}`,
  ];
  const reasons = Object.entries(refused).map(([reason, count]) => `${count} ${reason}`);
  if (reasons.length) parts.push(fair(`, reports refused: ${reasons.join(", ")}`));
  return parts;
}

/** @param {MissionDetail} mission */
function itemRows({ items, current }) {
  return items.map(({ seq, command, at, alt_m: alt, reference }) => {
    const isCurrent = seq === current;
    const attributes = isCurrent ? { class: "current", "aria-current": "step" } : {};
    return el(
      "tr",
      attributes,
      el("td", { class: "left" }, isCurrent ? `▶ ${seq}` : String(seq)),
      el("td", { class: "left" }, command.replaceAll("_", " ").toLowerCase()),
      el("td", {}, number(at?.[0])),
      el("td", {}, number(at?.[1])),
      el("td", {}, at ? number(alt) : "–"),
      el("td", { class: "left" }, at ? (reference === "msl" ? "sea level" : "home") : ""),
    );
  });
}
