// Panel of one vehicle: everything of its record, and its onboard mission, which the map draws too.

import { el, setText } from "./dom.js";
import { duration, number, seconds } from "./format.js";

const PERIOD_MS = 1000;
const RATE_S = 2;

const bad = (text) => el("span", { class: "bad" }, text);
const fair = (text) => el("span", { class: "fair" }, text);

export class Detail {
  constructor(root, feed, selection, map, panels) {
    this.root = root;
    this.panels = panels;
    this.feed = feed;
    this.selection = selection;
    this.map = map;
    this.record = null;
    this.before = null; // record of at least RATE_S ago, for the rate
    this.rate = null; // frames a second of the run
    this.build();
    selection.addEventListener("change", () => {
      panels.follow(selection.ids.size === 1);
      this.begin();
    });
    panels.addEventListener("change", () => this.begin());
    feed.addEventListener("data", ({ detail }) => {
      if (detail.fresh) this.load();
    });
    setInterval(() => this.load(), PERIOD_MS);
  }

  build() {
    this.title = el("h2");
    this.list = el("dl");
    this.items = el("tbody");
    const heads = [
      ["item", ""],
      ["command", "left"],
      ["east", ""],
      ["north", ""],
      ["alt m", ""],
    ];
    this.table = el(
      "table",
      { class: "dense" },
      el(
        "thead",
        {},
        el("tr", {}, ...heads.map(([text, align]) => el("th", { class: align, scope: "col" }, text))),
      ),
      this.items,
    );
    this.empty = el("p", { class: "empty" }, "Select one vehicle to see all that is known of it.");
    this.content = el("div", {}, this.title, this.list, this.table);
    this.root.append(this.empty, this.content);
    this.show();
  }

  get vehicle() {
    if (this.panels.current !== "detail" || this.selection.ids.size !== 1) return null;
    return this.selection.among(this.feed.data.vehicles ?? [])[0] ?? null;
  }

  begin() {
    if (this.record?.id !== this.vehicle?.id) this.keep(null);
    this.load();
  }

  keep(record) {
    const passed = record && this.before?.id === record.id ? record.t_s - this.before.t_s : -1;
    if (passed >= RATE_S) this.rate = (record.link.frames - this.before.link.frames) / passed;
    else if (passed < 0) this.rate = null;
    if (passed >= RATE_S || passed < 0) this.before = record;
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
    let record = null;
    try {
      const reply = await fetch(`api/vehicles/${encodeURIComponent(vehicle.name)}`, {
        signal: AbortSignal.timeout(3 * PERIOD_MS),
      });
      if (reply.ok) record = await reply.json();
    } catch {
      // The header tells that the connection is lost; the record stays as it was.
    }
    if (record && record.id === this.vehicle?.id) this.keep(record);
  }

  show() {
    this.content.hidden = !this.record;
    this.empty.hidden = Boolean(this.record);
    if (!this.record) return;
    setText(this.title, `Vehicle ${this.record.name}`);
    const rows = [
      ["authority", this.authority()],
      ["link", this.link()],
      ["mission", this.mission()],
      ["upload", this.upload()],
      ["pinned to", [this.record.pinned ?? "no target"]],
      ["return", this.returning()],
      ["position", this.position()],
    ];
    if (this.record.takeoff_problem)
      rows.push(["take-off", [bad(`not clear: ${this.record.takeoff_problem}`)]]);
    this.list.replaceChildren(
      ...rows.flatMap(([name, parts]) => [el("dt", {}, name), el("dd", {}, ...parts)]),
    );
    this.showItems();
  }

  authority() {
    const { claims } = this.record;
    if (!claims.length) return ["ours"];
    return claims.map(({ authority, reason, since_s: since }, index) =>
      el(
        "div",
        { class: index || authority === "ours" ? "" : "fair" },
        `${authority} for ${duration(since)}: ${reason}`,
      ),
    );
  }

  link() {
    const { link } = this.record;
    if (!link.address) return [bad("never heard")];
    const words = [
      link.state === "alive" ? "heard" : bad(link.state),
      ` at ${link.address}, ${this.rate === null ? "–" : number(this.rate)} frames/s, ${link.lost} of ${link.frames + link.lost} lost, `,
      `${link.signed ? "signed" : "not signed"}, ${link.autopilot || "unknown firmware"}`,
    ];
    if (link.conflicts) words.push(bad(`, ${link.conflicts} frames from another address`));
    if (link.reboots) words.push(fair(`, ${link.reboots} reboots`));
    return words;
  }

  mission() {
    const { mission } = this.record;
    if (!mission) return [fair("unknown")];
    const words = [
      `${mission.items.length} items to ${mission.target}, verified${mission.verified_s === null ? "" : ` ${duration(mission.verified_s)} ago`}`,
    ];
    if (mission.audited) words.push(fair(", being audited"));
    if (mission.inconsistent) words.push(bad(", may be inconsistent"));
    return words;
  }

  upload() {
    const { stage, since_s: since, failures, pause_s: pause } = this.record.upload;
    const words = [stage ? `${stage}${since === null ? "" : ` for ${seconds(since)}`}` : "none"];
    if (failures) words.push(bad(`, ${failures} failed`));
    if (pause) words.push(fair(`, next attempt in ${seconds(pause)}`));
    return words;
  }

  returning() {
    const { height, problem } = this.record.return;
    const words = [height || "height not known: run gcs preflight"];
    if (problem) words.push(fair(`, ${problem}`));
    return words;
  }

  position() {
    const { doubted, cusum, alarm_cusum: limit, refused } = this.record.position;
    const words = [
      doubted ? bad("doubted") : "consistent with the sensors",
      `, CUSUM ${number(cusum, 1)} of ${limit}`,
    ];
    const reasons = Object.entries(refused).map(([reason, count]) => `${count} ${reason}`);
    if (reasons.length) words.push(fair(`, reports refused: ${reasons.join(", ")}`));
    return words;
  }

  showItems() {
    const { mission } = this.record;
    this.table.hidden = !mission;
    if (!mission) return;
    this.items.replaceChildren(
      ...mission.items.map(({ seq, command, at, alt_m: alt }) => {
        const isCurrent = seq === mission.current;
        return el(
          "tr",
          { class: isCurrent ? "current" : "", "aria-current": isCurrent ? "step" : null },
          el("td", {}, isCurrent ? `▶ ${seq}` : String(seq)),
          el("td", { class: "left" }, command.replaceAll("_", " ").toLowerCase()),
          el("td", {}, at ? number(at[0]) : "–"),
          el("td", {}, at ? number(at[1]) : "–"),
          el("td", {}, at ? number(alt) : "–"),
        );
      }),
    );
  }
}
