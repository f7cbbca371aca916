// Preflight page: one table for each vehicle, and one for the mission.

import { el, setClass, setText } from "./dom.js";
import { Theme } from "./theme.js";

const STYLES = { ok: "arrived", warning: "fair", refused: "bad" };
const NETWORK = 256; // system ids of each network
const POLL_MS = 2000;

new Theme();
const part = (id) => document.getElementById(id);
let last = null;

function nameOf(vehicle) {
  if (vehicle === null) return "Mission";
  const network = Math.floor(vehicle / NETWORK);
  return `Vehicle ${network ? `${network}:` : ""}${vehicle % NETWORK}`;
}

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

function table(vehicle, checks) {
  const problems = checks.filter((one) => one.level !== "ok");
  const shown = part("brief").checked ? problems : checks;
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
  part("run").disabled = running || !possible;
  setText(part("run"), running ? "Checking …" : "Check now");
  if (!possible) setText(part("verdict"), "Only a service of gcs run can be checked.");
  if (!result) return;
  const at = new Date(result.at_ms).toISOString().slice(11, 19);
  if (result.error) {
    setText(part("verdict"), `${at} UTC: failed: ${result.error}`);
    setClass(part("verdict"), "bad");
    part("checks").replaceChildren();
    return;
  }
  const verdict = result.refused ? `${result.refused} refused: do not fly` : "nothing refused";
  setText(part("verdict"), `${at} UTC: ${verdict}, ${result.warnings} warnings`);
  setClass(part("verdict"), result.refused ? "bad" : result.warnings ? "fair" : "arrived");
  const vehicles = [...new Set(result.checks.map((one) => one.vehicle))];
  part("checks").replaceChildren(
    ...vehicles.flatMap((vehicle) =>
      table(
        vehicle,
        result.checks.filter((one) => one.vehicle === vehicle),
      ),
    ),
  );
}

async function load(method = "GET") {
  const body =
    method === "POST" ? { method, headers: { "content-type": "application/json" }, body: "{}" } : {};
  try {
    const reply = await fetch("/api/preflight", body);
    const content = await reply.json();
    if (!reply.ok) throw new Error(content.error);
    last = content;
    show();
    if (last.running) setTimeout(load, POLL_MS);
  } catch (error) {
    part("run").disabled = false;
    setText(part("run"), "Check now");
    setText(part("verdict"), `not checked: ${error.message}`);
    setClass(part("verdict"), "bad");
  }
}

part("run").addEventListener("click", () => {
  last = { ...(last ?? { possible: true, result: null }), running: true };
  show();
  load("POST");
});
part("brief").addEventListener("change", () => last && show());
load();
