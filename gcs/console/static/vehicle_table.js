// Table of vehicles: one row for each vehicle, those that need attention first.

import { el, Rows, setClass, setText } from "./dom.js";
import { DENSE_ROWS, duration, FIXES, number, seconds } from "./format.js";

const COLUMNS = [
  ["id", "id", "id", (v) => v.name],
  ["status", "status", "left", (v) => (v.doubted ? ["doubted", "bad"] : [v.status, v.status])],
  ["authority", "authority", "left", (v) => [v.authority, v.authority === "ours" ? "faint" : "fair"]],
  ["mode", "mode", "left", (v) => v.mode || "–"],
  ["armed", "armed", "left", (v) => (v.armed ? "armed" : "–")],
  ["alt", "alt m", "", (v) => number(v.alt_m)],
  ["layer", "layer", "", (v) => [v.target && v.status === "active" ? String(v.layer) : "–", "faint"]],
  ["speed", "m/s", "", (v) => number(v.speed_m_s)],
  ["battery", "batt", "", (v) => [v.battery === null ? "–" : `${v.battery} %`, v.battery_low ? "bad" : ""]],
  [
    "fix",
    "fix",
    "",
    (v) => [
      v.fix === null ? "–" : (FIXES[v.fix] ?? String(v.fix)),
      v.fix !== null && v.fix < 3 ? "bad" : "faint",
    ],
  ],
  [
    "heard",
    "heard",
    "",
    (v) => [v.heard_s === null ? "never" : seconds(v.heard_s), v.late ? "bad" : "faint"],
  ],
  ["loss", "loss", "", (v) => [`${(100 * v.loss).toFixed(1)} %`, v.loss > 0.2 ? "fair" : "faint"]],
  ["target", "target", "", target],
  ["eta", "ETA", "", (v) => duration(v.eta_s)],
  ["mission", "mission", "left wide", mission],
];

function target(vehicle) {
  const shown = vehicle.target ?? (vehicle.proposed ? `${vehicle.proposed}?` : "–");
  if (!vehicle.pinned) return shown;
  return vehicle.pinned === vehicle.target ? `pin ${shown}` : [`${shown}, pin ${vehicle.pinned}`, "fair"];
}

function mission(vehicle) {
  if (vehicle.status === "lost") return ["–", "faint"];
  if (vehicle.problems?.length) return [vehicle.problems.join("; "), "bad"];
  if (vehicle.reason) return [vehicle.reason, "fair"];
  if (vehicle.upload)
    return [vehicle.upload === "upload" ? "uploading" : `upload: ${vehicle.upload}`, "active"];
  if (vehicle.failed) return ["upload failed", "bad"];
  return [vehicle.verified ? "verified" : "–", "faint"];
}

export function showVehicles(root, feed, selection) {
  const count = el("h2", {}, "Vehicles");
  const head = el(
    "tr",
    {},
    ...COLUMNS.map(([name, title, align]) => el("th", { class: `c-${name} ${align}`, scope: "col" }, title)),
  );
  const body = el("tbody");
  const table = el("table", {}, el("thead", {}, head), body);
  root.append(count, table);

  const rows = new Rows(
    body,
    (vehicle) => {
      const cells = COLUMNS.map(() => el("td"));
      const element = el(
        "tr",
        {
          tabindex: "0",
          "data-id": vehicle.id,
          onclick: (event) => selection.toggle(vehicle.id, event.shiftKey || event.ctrlKey || event.metaKey),
          onkeydown: (event) => {
            if (event.key === "Enter") selection.toggle(vehicle.id, event.shiftKey || event.ctrlKey);
          },
        },
        ...cells,
      );
      return { element, cells };
    },
    (row, vehicle) => {
      setClass(row.element, ["lost", "down"].includes(vehicle.status) ? "gone" : "");
      COLUMNS.forEach(([name, , align, value], index) => {
        const shown = value(vehicle);
        const [text, style] = Array.isArray(shown) ? shown : [shown, ""];
        setText(row.cells[index], text);
        setClass(row.cells[index], `c-${name} ${align} ${style}`);
        if (name === "mission") row.cells[index].title = text;
      });
    },
  );

  const mark = () => {
    for (const [id, row] of rows.rows) row.element.setAttribute("aria-selected", String(selection.has(id)));
  };
  feed.on(["vehicles"], ({ vehicles }) => {
    const counts = ["active", "arrived", "lost", "down"].map((name) => [
      name,
      vehicles.filter((one) => one.status === name).length,
    ]);
    setText(
      count,
      `Vehicles: ${counts
        .filter(([, n]) => n)
        .map(([name, n]) => `${n} ${name}`)
        .join(", ")}`,
    );
    table.classList.toggle("dense", vehicles.length > DENSE_ROWS);
    rows.show(vehicles, (vehicle) => vehicle.id);
    mark();
  });
  selection.addEventListener("change", mark);
}
