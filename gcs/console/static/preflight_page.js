// Preflight page: one table for each vehicle, and one for the mission.

/** @import { CheckRow, PreflightReply, PreflightRun } from "../page_types.d.ts" */

import { el, part, setClass, setText } from "./dom.js";
import { utc, vehicleName } from "./format.js";
import { post } from "./requests.js";
import { Theme } from "./theme.js";

const STYLES = { ok: "arrived", warning: "fair", refused: "bad" };
const POLL_MS = 2000;

new Theme();
const run = /** @type {HTMLButtonElement} */ (part("run"));
const brief = /** @type {HTMLInputElement} */ (part("brief"));
const verdict = part("verdict");
const tables = part("checks");
/** @type {PreflightReply} */
let last = { possible: true, running: false, result: null };

/** @param {number | null} vehicle */
function nameOf(vehicle) {
  return vehicle === null ? "Mission" : `Vehicle ${vehicleName(vehicle)}`;
}

/** @param {CheckRow} check */
function row({ name, level, value, wanted, remedy }) {
  const isGood = level === "ok";
  return el(
    "tr",
    {},
    el("td", {}, name),
    el("td", { class: STYLES[level] }, level),
    el("td", {}, value),
    el("td", {}, isGood || !wanted ? "" : `expected: ${wanted}`),
    el("td", {}, isGood ? "" : remedy),
  );
}

/**
 * @param {number | null} vehicle
 * @param {CheckRow[]} checks
 */
function table(vehicle, checks) {
  const problems = checks.filter((one) => one.level !== "ok");
  const shown = brief.checked ? problems : checks;
  const count = problems.length
    ? `${problems.length} of ${checks.length} checks not ok`
    : `${checks.length} checks ok`;
  return [
    el("h2", {}, `${nameOf(vehicle)}: ${count}`),
    el("table", { class: "checks" }, el("tbody", {}, ...shown.map(row))),
  ];
}

function show() {
  const { possible, running, result } = last;
  run.disabled = running || !possible;
  setText(run, running ? "Checking …" : "Check now");
  if (!possible) setText(verdict, "Only a service of gcs run can be checked.");
  if (result) showResult(result);
}

/** @param {PreflightRun} result */
function showResult(result) {
  const time = `${utc(result.at_ms)} UTC`;
  if (result.error) {
    showVerdict(`${time}: failed: ${result.error}`, "bad");
    tables.replaceChildren();
    return;
  }
  const { refused, warnings, checks } = result;
  const found = refused ? `${refused} refused: do not fly` : "nothing refused";
  showVerdict(`${time}: ${found}, ${warnings} warnings`, refused ? "bad" : warnings ? "fair" : "arrived");
  const vehicles = [...new Set(checks.map((one) => one.vehicle))];
  const of = vehicles.map((vehicle) => checks.filter((one) => one.vehicle === vehicle));
  tables.replaceChildren(...vehicles.flatMap((vehicle, index) => table(vehicle, of[index])));
}

/**
 * @param {string} text
 * @param {string} style
 */
function showVerdict(text, style) {
  setText(verdict, text);
  setClass(verdict, style);
}

/** @param {Promise<Response>} asked */
async function load(asked) {
  try {
    const reply = await asked;
    const content = await reply.json();
    if (!reply.ok) throw new Error(content.error);
    last = content;
    show();
    if (last.running) setTimeout(() => load(fetch("/api/preflight")), POLL_MS);
  } catch (error) {
    run.disabled = false;
    setText(run, "Check now");
    showVerdict(`not checked: ${error instanceof Error ? error.message : error}`, "bad");
  }
}

run.addEventListener("click", () => {
  last = { ...last, running: true };
  show();
  load(post("/api/preflight", {}));
});
brief.addEventListener("change", show);
load(fetch("/api/preflight"));
