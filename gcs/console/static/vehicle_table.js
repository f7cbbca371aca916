// Table of vehicles: one row for each, those that need attention first.

/**
 * @import { AgentRecord } from "../page_types.d.ts"
 * @import { Feed } from "./feed.js"
 * @import { Selection } from "./selection.js"
 *
 * @typedef {[text: string, style: string]} Cell
 * @typedef {{ name: string, title: string, style: string, cell: (vehicle: AgentRecord) => Cell | string }} Column
 */

import { el, Rows, setClass, setText, tableOf } from "./dom.js";
import { duration, number, seconds, targetName, vehicleName } from "./format.js";

const DENSE_ROWS = 24; // from so many vehicles on, rows are low
const FIXES = ["none", "none", "2D", "3D", "DGPS", "float", "RTK", "static"];
const MIN_FIX = 3;
const MAX_LOSS = 0.2;
/** @type {AgentRecord["status"][]} */
const STATUSES = ["active", "arrived", "lost", "down"];

/** @type {Column[]} */
const COLUMNS = [
  { name: "id", title: "id", style: "id", cell: (one) => vehicleName(one.vehicle) },
  {
    name: "status",
    title: "status",
    style: "left",
    cell: (one) => (one.is_position_doubted ? ["doubted", "bad"] : [one.status, one.status]),
  },
  {
    name: "authority",
    title: "authority",
    style: "left",
    cell: (one) => [one.authority, one.authority === "ours" ? "faint" : "fair"],
  },
  { name: "mode", title: "mode", style: "left", cell: (one) => one.mode || "–" },
  { name: "armed", title: "armed", style: "left", cell: (one) => (one.armed ? "armed" : "–") },
  { name: "alt", title: "alt m", style: "", cell: (one) => number(one.alt_rel_m) },
  { name: "agl", title: "AGL m", style: "", cell: (one) => number(one.agl_m) },
  { name: "layer", title: "layer", style: "", cell: layerCell },
  { name: "speed", title: "m/s", style: "", cell: (one) => number(one.ground_speed_m_s) },
  {
    name: "battery",
    title: "batt",
    style: "",
    cell: (one) => [number(one.battery_percent, 0, " %"), one.is_battery_low ? "bad" : ""],
  },
  { name: "fix", title: "fix", style: "", cell: fixCell },
  { name: "heard", title: "heard", style: "", cell: heardCell },
  {
    name: "loss",
    title: "loss",
    style: "",
    cell: (one) => [number(100 * one.loss, 1, " %"), one.loss > MAX_LOSS ? "fair" : "faint"],
  },
  { name: "target", title: "target", style: "", cell: targetCell },
  { name: "eta", title: "ETA", style: "", cell: (one) => duration(one.eta_s) },
  { name: "mission", title: "mission", style: "left wide", cell: missionCell },
];

/**
 * @param {AgentRecord} vehicle
 * @returns {Cell}
 */
function layerCell({ target, status, layer }) {
  return [target && status === "active" ? String(layer) : "–", "faint"];
}

/**
 * @param {AgentRecord} vehicle
 * @returns {Cell}
 */
function fixCell({ fix_type: fix }) {
  if (fix === null) return ["–", "faint"];
  return [FIXES[fix] ?? String(fix), fix < MIN_FIX ? "bad" : "faint"];
}

/**
 * @param {AgentRecord} vehicle
 * @returns {Cell}
 */
function heardCell({ heard_age_s: heard, is_late: isLate }) {
  return [heard === null ? "never" : seconds(heard), isLate ? "bad" : "faint"];
}

/**
 * @param {AgentRecord} vehicle
 * @returns {Cell | string}
 */
export function targetCell({ target, proposed_target: proposed, pinned }) {
  const shown = target ? targetName(target) : proposed ? `${targetName(proposed)}?` : "–";
  if (!pinned) return shown;
  const pin = targetName(pinned);
  return pin === shown ? `pin ${shown}` : [`${shown}, pin ${pin}`, "fair"];
}

/**
 * @param {AgentRecord} vehicle
 * @returns {Cell}
 */
export function missionCell({ status, problems, reason, upload, has_failed: failed, is_verified: verified }) {
  if (status === "lost") return ["–", "faint"];
  if (problems.length) return [problems.join("; "), "bad"];
  if (reason) return [reason, "fair"];
  if (upload) return [upload === "upload" ? "uploading" : `upload: ${upload}`, "active"];
  if (failed) return ["upload failed", "bad"];
  return [verified ? "verified" : "–", "faint"];
}

/** @param {AgentRecord[]} vehicles */
function countsOf(vehicles) {
  const counts = STATUSES.map((status) => ({
    status,
    count: vehicles.filter((one) => one.status === status).length,
  }));
  return counts
    .filter(({ count }) => count)
    .map(({ status, count }) => `${count} ${status}`)
    .join(", ");
}

/**
 * @param {HTMLElement} root
 * @param {Feed} feed
 * @param {Selection} selection
 */
export function showVehicles(root, feed, selection) {
  const title = el("h2", {}, "Vehicles");
  const body = el("tbody");
  const table = tableOf(
    COLUMNS.map(({ name, title: head, style }) => [head, `c-${name} ${style}`]),
    body,
  );
  root.append(title, table);

  /** @type {Rows<AgentRecord, number, ReturnType<typeof makeRow>>} */
  const rows = new Rows(
    body,
    (vehicle) => makeRow(vehicle, selection),
    updateRow,
    ({ vehicle }) => vehicle,
  );
  const mark = () => rows.mark((id) => selection.has(id));
  feed.on("vehicles", (vehicles) => {
    setText(title, `Vehicles: ${countsOf(vehicles)}`);
    table.classList.toggle("dense", vehicles.length > DENSE_ROWS);
    rows.show(vehicles);
    mark();
  });
  selection.addEventListener("change", mark);
}

/**
 * @param {AgentRecord} vehicle
 * @param {Selection} selection
 */
function makeRow({ vehicle: id }, selection) {
  const cells = COLUMNS.map(() => el("td"));
  const attributes = {
    tabindex: 0,
    "data-id": id,
    onclick: (/** @type {MouseEvent} */ event) => selection.toggle(id, event),
    onkeydown: (/** @type {KeyboardEvent} */ event) => {
      if (event.key === "Enter") selection.toggle(id, event);
    },
  };
  return { element: el("tr", attributes, ...cells), cells };
}

/**
 * @param {ReturnType<typeof makeRow>} row
 * @param {AgentRecord} vehicle
 */
function updateRow({ element, cells }, vehicle) {
  setClass(element, vehicle.status === "lost" || vehicle.status === "down" ? "gone" : "");
  for (const [index, { name, style, cell }] of COLUMNS.entries()) {
    const shown = cell(vehicle);
    const [text, more] = typeof shown === "string" ? [shown, ""] : shown;
    setText(cells[index], text);
    setClass(cells[index], `c-${name} ${style} ${more}`);
    if (name === "mission") cells[index].title = text;
  }
}
