// Panel with the targets, and the no-fly zones with the buttons that change and open each.

/**
 * @import { SensorRecord, TargetRecord } from "../page_types.d.ts"
 * @import { Feed } from "./feed.js"
 * @import { SwarmMap } from "./map.js"
 * @import { Selection } from "./selection.js"
 * @import { Zones } from "./zone_dialog.js"
 */

import { el, Rows, setClass, setText, tableOf } from "./dom.js";
import { limitsText, number, seconds, targetName, vehicleName } from "./format.js";

const DENSE_ROWS = 12; // from so many targets on, rows are low
const MAX_ROWS = 100;
const AGENTS_COLUMN = 5;
/** @type {[string, string][]} */
const HEADS = [
  ["target", "left"],
  ["existence", ""],
  ["east", ""],
  ["north", ""],
  ["m/s", ""],
  ["agents", "left"],
  ["by order", "left"],
];

/** @param {number[]} vehicles */
const namesOf = (vehicles) => vehicles.map(vehicleName).join(", ");

/**
 * Return the place of a target in the table: those without an agent first, ignored ones last.
 *
 * @param {TargetRecord} target
 */
function rankOf({ agents, reached_by: reached, is_ignored: isIgnored }) {
  if (isIgnored) return 3;
  if (reached.length) return 2;
  return agents.length ? 1 : 0;
}

/**
 * Return what was ordered about a target.
 *
 * @param {Pick<TargetRecord, "is_ignored" | "priority" | "pinned">} target
 */
export function orderedOf({ is_ignored: isIgnored, priority, pinned }) {
  const parts = [];
  if (isIgnored) parts.push("ignored");
  if (priority !== null) parts.push(`priority ${priority}`);
  if (pinned.length) parts.push(`pinned ${namesOf(pinned)}`);
  return parts.join(", ");
}

/**
 * Return how old the targets are, if no sensor tells of them in time.
 *
 * @param {Pick<SensorRecord, "scan_age_s" | "state">[]} sensors
 */
export function stalenessOf(sensors) {
  if (sensors.some((one) => !one.state)) return "";
  const ages = sensors.flatMap(({ scan_age_s: age }) => (age === null ? [] : [age]));
  return ages.length ? `, no scan for ${seconds(Math.min(...ages))}` : ", no scan yet";
}

/**
 * @param {HTMLElement} root
 * @param {Feed} feed
 * @param {SwarmMap} map
 * @param {Selection} selection
 * @param {Zones} editor
 */
export function showTargets(root, feed, map, selection, editor) {
  const title = el("span", {}, "Targets");
  const stale = el("span", { class: "fair" });
  const body = el("tbody");
  const table = tableOf(HEADS, body);
  const zones = el("div");
  root.append(el("h2", {}, title, stale), table, zones);

  /** @param {string} name */
  const choose = (name) => {
    const target = feed.data.targets.find((one) => targetName(one.label) === name);
    selection.toggleTarget(name);
    if (target) map.motion.show(target.position_m);
  };
  /** @type {Rows<TargetRecord, string, ReturnType<typeof makeRow>>} */
  const rows = new Rows(
    body,
    ({ label }) => makeRow(targetName(label), choose),
    updateRow,
    ({ label }) => targetName(label),
  );
  const mark = () => rows.mark((name) => selection.target === name);
  selection.addEventListener("change", mark);
  feed.on("head", (head) => setText(stale, stalenessOf(head.sensors)));
  feed.on("targets", (targets) => {
    const more = targets.length > MAX_ROWS ? `, the first ${MAX_ROWS} shown` : "";
    setText(title, `Targets: ${targets.length}${more}`);
    table.hidden = !targets.length;
    table.classList.toggle("unordered", !targets.some(orderedOf));
    table.classList.toggle("dense", targets.length > DENSE_ROWS);
    const sorted = [...targets].sort((a, b) => rankOf(a) - rankOf(b));
    rows.show(sorted.slice(0, MAX_ROWS));
    mark();
  });
  feed.onAny(["zones", "mission"], () => zones.replaceChildren(...zoneParts(feed, editor)));
}

/**
 * @param {string} name
 * @param {(name: string) => void} choose
 */
function makeRow(name, choose) {
  const cells = HEADS.map(([, style]) => el("td", { class: style }));
  const attributes = {
    tabindex: 0,
    "data-target": name,
    onclick: () => choose(name),
    onkeydown: (/** @type {KeyboardEvent} */ event) => {
      if (event.key === "Enter") choose(name);
    },
  };
  return { element: el("tr", attributes, ...cells), cells };
}

/**
 * @param {ReturnType<typeof makeRow>} row
 * @param {TargetRecord} target
 */
function updateRow({ element, cells }, target) {
  const { agents, reached_by: reached, is_ignored: isIgnored } = target;
  const texts = [
    targetName(target.label),
    number(target.existence, 2),
    number(target.position_m[0]),
    number(target.position_m[1]),
    number(target.speed_m_s, 1),
    reached.length ? `reached by ${namesOf(reached)}` : namesOf(agents) || "none",
    orderedOf(target),
  ];
  for (const [index, text] of texts.entries()) setText(cells[index], text);
  const isOpen = !agents.length && !isIgnored;
  setClass(cells[AGENTS_COLUMN], `left ${reached.length ? "arrived" : isOpen ? "fair" : ""}`);
  setClass(element, isIgnored ? "ignored" : "");
}

/**
 * @param {Feed} feed
 * @param {Zones} editor
 */
function zoneParts({ data: { zones, mission } }, editor) {
  if (!zones.length) return [];
  const disabled = mission?.kind !== "live";
  const rows = zones.map(({ name, limits }) =>
    el(
      "div",
      { class: "actions" },
      el("button", { title: name, disabled, onclick: () => editor.edit(name) }, `Edit ${name}`),
      el("button", { title: name, disabled, onclick: () => editor.reopen(name) }, `Open ${name}`),
      el("span", {}, limitsText(limits) || "at all heights"),
    ),
  );
  return [el("h2", {}, `No-fly zones: ${zones.length}`), ...rows];
}
