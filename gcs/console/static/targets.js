// Targets, and the no-fly zones with the buttons that change and open each.

import { el, Rows, setClass, setText } from "./dom.js";
import { number, seconds } from "./format.js";

const DENSE_ROWS = 12;
const MAX_ROWS = 100;

// Targets without an agent first, ignored ones last.
const rank = ({ agents, reached_by: reached, ignored }) =>
  ignored ? 3 : reached.length ? 2 : agents.length ? 1 : 0;

// What was ordered about a target.
export function ordered({ ignored, priority, pinned }) {
  const parts = [
    ignored && "ignored",
    priority !== null && `priority ${priority}`,
    pinned.length && `pinned ${pinned.join(", ")}`,
  ];
  return parts.filter(Boolean).join(", ");
}

// How old the targets are, if no sensor tells of them in time.
function staleness(sensors) {
  if (sensors.some((one) => !one.state)) return "";
  const ages = sensors.map((one) => one.age_s).filter((age) => age !== null);
  return ages.length ? `, no scan for ${seconds(Math.min(...ages))}` : ", no scan yet";
}

export function showTargets(root, feed, map, selection, editor) {
  const title = el("span", {}, "Targets");
  const stale = el("span", { class: "fair" });
  const body = el("tbody");
  const heads = [
    ["target", "left"],
    ["existence", ""],
    ["east", ""],
    ["north", ""],
    ["m/s", ""],
    ["agents", "left"],
    ["by order", "left"],
  ];
  const head = el("tr", {}, ...heads.map(([text, align]) => el("th", { class: align, scope: "col" }, text)));
  const table = el("table", {}, el("thead", {}, head), body);
  const zones = el("div");
  root.append(el("h2", {}, title, stale), table, zones);

  const rows = new Rows(
    body,
    (target) => {
      const cells = heads.map(([, align]) => el("td", { class: align }));
      const choose = () => {
        selection.setTarget(selection.target === target.name ? null : target.name);
        map.show(element.place);
      };
      const element = el(
        "tr",
        {
          tabindex: "0",
          "data-target": target.name,
          onclick: choose,
          onkeydown: (event) => {
            if (event.key === "Enter") choose();
          },
        },
        ...cells,
      );
      return { element, cells };
    },
    (row, target) => {
      row.element.place = target.at;
      const who = target.reached_by.length
        ? `reached by ${target.reached_by.join(", ")}`
        : target.agents.join(", ") || "none";
      const texts = [
        target.name,
        number(target.existence, 2),
        number(target.at[0]),
        number(target.at[1]),
        number(target.speed_m_s, 1),
        who,
        ordered(target),
      ];
      texts.forEach((text, index) => setText(row.cells[index], text));
      const isOpen = !target.agents.length && !target.ignored;
      setClass(row.cells[5], `left ${target.reached_by.length ? "arrived" : isOpen ? "fair" : ""}`);
      setClass(row.element, target.ignored ? "ignored" : "");
    },
  );
  const mark = () => {
    for (const [name, row] of rows.rows)
      row.element.setAttribute("aria-selected", String(selection.target === name));
  };
  selection.addEventListener("change", mark);
  feed.on(["head"], ({ head }) => setText(stale, staleness(head.sensors)));
  feed.on(["targets"], ({ targets }) => {
    setText(
      title,
      `Targets: ${targets.length}${targets.length > MAX_ROWS ? `, the first ${MAX_ROWS} shown` : ""}`,
    );
    table.hidden = !targets.length;
    table.classList.toggle("unordered", !targets.some(ordered));
    table.classList.toggle("dense", targets.length > DENSE_ROWS);
    const sorted = [...targets].sort((a, b) => rank(a) - rank(b));
    rows.show(sorted.slice(0, MAX_ROWS), (target) => target.name);
    mark();
  });
  feed.on(["zones", "mission"], ({ zones: closed = [], mission }) => {
    const disabled = mission.kind !== "live";
    const buttons = closed.flatMap(({ name }) => [
      el("button", { title: name, onclick: () => editor.edit(name), disabled }, `Edit ${name}`),
      el("button", { title: name, onclick: () => editor.reopen(name), disabled }, `Open ${name}`),
    ]);
    zones.replaceChildren(
      ...(closed.length
        ? [el("h2", {}, `No-fly zones: ${closed.length}`), el("div", { class: "actions" }, ...buttons)]
        : []),
    );
  });
}
