// Two recordings side by side: the page of each in a frame, one time line, linked maps, and what differs.

import { showKeys } from "./dialogs.js";
import { el, setText } from "./dom.js";
import { duration, number } from "./format.js";
import { KEYS, listenToKeys } from "./keys.js";
import { Marks } from "./marks.js";
import { Replay } from "./replay.js";
import { Theme } from "./theme.js";
import { toLocal } from "./tiles.js";

const PAGES = { A: "/index.html", B: "/b/" };

const agents =
  (status) =>
  ({ vehicles }) =>
    vehicles?.filter((one) => one.status === status).length;
const figure =
  (name) =>
  ({ replay }) =>
    replay?.figures[name];
const FIGURES = [
  ["Agents active", agents("active")],
  ["arrived", agents("arrived")],
  ["lost", agents("lost")],
  ["Targets", ({ targets }) => targets?.length],
  ["OSPA agents, m", figure("ospa_agents_m"), 1],
  ["OSPA targets, m", figure("ospa_targets_m"), 1],
  ["Re-tasks", figure("retasks")],
  ["Failed uploads", figure("failed_uploads")],
];

// What the replay bar reads, of both recordings: their position, which is the later one, and their marks.
class Both extends EventTarget {
  constructor(panes) {
    super();
    this.panes = panes;
    this.all = [];
  }

  get data() {
    const states = this.panes.map((pane) => pane.feed?.data.replay).filter(Boolean);
    if (states.length < this.panes.length) return {};
    const most = (name) => Math.max(...states.map((one) => one[name] ?? one.at_s));
    const every = (name) => states.every((one) => one[name]);
    return {
      replay: {
        ...states[0],
        at_s: most("at_s"),
        duration_s: most("duration_s"),
        ended: every("ended"),
        back: every("back"),
      },
    };
  }

  on(_names, callback) {
    this.addEventListener("data", callback);
  }

  want() {} // the marks of both are wanted from the start

  near(at, within) {
    return Marks.prototype.near.call(this, at, within);
  }

  gather() {
    const named = ({ name, marks }, row) =>
      marks.all.map((mark) => ({ ...mark, text: `${name}: ${mark.text}`, height: 0.25 + 0.5 * row }));
    this.all = this.panes.flatMap((pane, row) => (pane.marks ? named(pane, row) : []));
    this.dispatchEvent(new Event("change"));
  }
}

class Comparison {
  constructor() {
    this.theme = new Theme();
    this.panes = Object.entries(PAGES).map(([name, src]) => this.pane(name, src));
    this.both = new Both(this.panes);
    this.replay = new Replay(document.getElementById("replay"), this.both, this.both, this.theme);
    this.linked = true;
    this.linkButton = el(
      "button",
      { title: "A map moves with the other", "aria-pressed": "true", onclick: () => this.toggleLink() },
      "Link maps",
    );
    document
      .getElementById("actions")
      .append(
        this.linkButton,
        el("button", { title: "Dark or light", onclick: () => this.theme.toggle() }, "Theme"),
        el("button", { title: "Keys (?)", onclick: () => showKeys(KEYS) }, "Keys"),
      );
    this.cells = this.table(document.getElementById("figures"));
  }

  pane(name, src) {
    const file = el("span", { class: "file" });
    const state = el("span", { class: "fair", role: "status" });
    const frame = el("iframe", { title: `Recording ${name}`, src });
    const element = el(
      "section",
      { class: "pane", "aria-label": `Recording ${name}` },
      el("h2", {}, el("b", {}, name), file, state),
      frame,
    );
    return { name, file, state, frame, element };
  }

  table(root) {
    const row = (name, ...cells) => {
      root.append(el("div", { role: "row" }, name, ...cells));
      return cells;
    };
    const head = (text) => el("span", { role: "columnheader" }, text);
    row(head("At this time"), ...this.panes.map(({ name }) => head(name)), head("B − A"));
    return FIGURES.map(([text]) =>
      row(
        el("span", { role: "rowheader" }, text),
        ...Array.from({ length: 3 }, () => el("span", { role: "cell" })),
      ),
    );
  }

  start() {
    document.querySelector("main").append(...this.panes.map(({ element }) => element));
  }

  // A page in a frame has loaded, and gives its parts.
  add(frame, parts) {
    const pane = this.panes.find((one) => one.frame === frame);
    Object.assign(pane, parts);
    parts.map.onmove = () => this.moveOther(pane);
    parts.marks.addEventListener("change", () => this.both.gather());
    parts.marks.want();
    parts.feed.addEventListener("data", (event) => this.show(pane, event.detail.names));
    if (pane === this.panes[0])
      listenToKeys({ ...parts.actions, "?": () => showKeys(KEYS) }, parts.feed, parts.selection);
  }

  show(pane, names) {
    const { mission, replay } = pane.feed.data;
    setText(pane.file, mission?.title ?? "");
    pane.file.title = mission?.title ?? "";
    setText(pane.state, replay?.ended ? `ended at ${duration(replay.at_s)}` : "");
    if (this.both.data.replay && names.has("replay")) this.both.dispatchEvent(new Event("data"));
    if (!this.hasBegun && this.panes.every((one) => one.feed?.data.mission)) {
      this.hasBegun = true;
      this.align();
    }
    this.frame ??= requestAnimationFrame(() => {
      this.frame = null;
      this.showFigures();
    });
  }

  showFigures() {
    FIGURES.forEach(([, value, digits = 0], index) => {
      const [a, b] = this.panes.map(({ feed }) => (feed ? value(feed.data) : null) ?? null);
      const apart = a === null || b === null ? null : b - a;
      const sign = apart > 0 ? "+" : apart < 0 ? "−" : "";
      [a, b].forEach((one, column) => setText(this.cells[index][column], number(one, digits)));
      setText(this.cells[index][2], apart === null ? "–" : sign + number(Math.abs(apart), digits));
    });
  }

  toggleLink() {
    this.linked = !this.linked;
    this.linkButton.setAttribute("aria-pressed", String(this.linked));
    this.align();
  }

  // Of what the two maps show, shows the larger part in both.
  align() {
    const [a, b] = this.panes;
    if (this.hasBegun) this.moveOther(a.map.view.scale <= b.map.view.scale ? a : b);
  }

  moveOther(pane) {
    if (!this.linked || !this.hasBegun) return;
    const other = this.panes.find((one) => one !== pane);
    const [east, north] = offset(pane.feed.data.mission, other.feed.data.mission);
    const { view } = pane.map;
    other.map.look(view.east + east, view.north + north, view.scale);
  }
}

// Of one mission's origin from that of another. Areas that are far apart are laid over each other.
function offset(mission, other) {
  const [lat, lon] = mission.origin_deg;
  const place = toLocal([...other.origin_deg, other.origin_alt_m], lat, lon);
  return Math.hypot(...place) < Math.hypot(...other.size_m) ? place : [0, 0];
}

window.comparison = new Comparison();
window.comparison.start(); // the frames look for it
