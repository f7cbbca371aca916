// Charts of the run, beside the map. They are fetched only while they are open.

import { LineChart, MarkChart, RowChart, TimeAxis } from "./chart.js";
import { el } from "./dom.js";
import { KINDS, markText } from "./marks.js";

const POLL_MS = 2000;
const AROUND_S = 30;
const MAX_LINES = 8; // with more vehicles, only the selected ones are named
const COLOURS = ["series-1", "series-2", "series-3", "series-4", "series-5", "series-6"];
const DASHES = [null, [6, 3], [2, 2]];

export class Charts {
  constructor(root, feed, marks, selection, theme, panels, seek) {
    Object.assign(this, { root, feed, marks, selection, theme, panels });
    this.wasOpen = false;
    this.axis = new TimeAxis();
    const isReplay = () => feed.data.mission?.kind === "replay";
    const common = [
      this.axis,
      theme,
      (at) => {
        if (isReplay()) seek(at);
      },
    ];
    const whole = el(
      "button",
      { hidden: true, onclick: () => this.axis.zoom(null) },
      "Whole run",
      el("kbd", {}, "W"),
    );
    this.axis.addEventListener("zoom", () => {
      whole.hidden = !this.axis.zoomed;
    });
    root.append(
      el(
        "h2",
        {},
        "Charts",
        el("span", { class: "space" }),
        whole,
        el(
          "button",
          { "aria-label": "Close the charts", onclick: () => panels.toggle("charts") },
          "Close",
          el("kbd", {}, "G"),
        ),
      ),
    );
    this.events = new MarkChart(root, "Events", ...common);
    this.objects = new LineChart(root, "Number of objects (± 1σ)", "", ...common, { digits: 1 });
    this.ospa = new LineChart(root, "OSPA of positions (c = 100 m, p = 1)", "m", ...common, { digits: 1 });
    this.rate = new LineChart(root, "Messages received", "1/s", ...common, { digits: 1 });
    this.loss = new LineChart(root, "Messages lost", "%", ...common, { digits: 1 });
    this.battery = new LineChart(root, "Battery", "%", ...common, { least: 100 });
    this.work = new LineChart(
      root,
      "Longest computing time (in a replay: of what was played)",
      "ms",
      ...common,
      { digits: 1 },
    );
    this.targets = new RowChart(root, "Existence probability of target tracks", ...common);
    this.agents = new RowChart(root, "Existence probability of agent tracks", ...common);
    this.charts = [
      this.events,
      this.objects,
      this.ospa,
      this.rate,
      this.loss,
      this.battery,
      this.work,
      this.targets,
      this.agents,
    ];
    feed.on(["replay", "head"], () => this.showTime());
    marks.addEventListener("change", () => this.showMarks());
    selection.addEventListener("change", () => this.show());
    theme.addEventListener("change", () => this.draw());
    panels.addEventListener("change", () => this.changed());
    new ResizeObserver(() => this.draw()).observe(root);
  }

  get isOpen() {
    return this.panels.current === "charts";
  }

  changed() {
    if (this.isOpen === this.wasOpen) return;
    this.wasOpen = this.isOpen;
    this.marks[this.isOpen ? "want" : "release"]();
    if (this.isOpen) this.load();
  }

  // Shows a minute around the time of the replay, or the last one; then the whole run again.
  zoom() {
    const { now, to, zoomed } = this.axis;
    const at = Math.min(now ?? to, to - AROUND_S);
    if (this.isOpen) this.axis.zoom(zoomed ? null : [at - AROUND_S, at + AROUND_S]);
  }

  async load() {
    if (!this.isOpen || this.timer) return;
    try {
      const reply = await fetch("api/charts");
      this.data = await reply.json();
      this.show();
    } catch {
      /* the server is away: the header says so */
    }
    this.timer = setTimeout(() => {
      this.timer = null;
      this.load();
    }, POLL_MS);
  }

  showTime() {
    const { replay, head } = this.feed.data;
    const now = replay ? replay.at_s : null;
    const to = Math.max(10, replay?.duration_s ?? head?.elapsed_s ?? 0);
    if (now === this.axis.now && to === this.axis.to) return;
    Object.assign(this.axis, { now, to });
    if (this.isOpen) this.draw();
  }

  showMarks() {
    if (this.isOpen) this.events.show(this.marks.all, KINDS, markText);
  }

  draw() {
    if (this.isOpen)
      this.frame ??= requestAnimationFrame(() => {
        this.frame = null;
        for (const chart of this.charts) chart.draw();
      });
  }

  show() {
    const { data } = this;
    if (!this.isOpen || !data) return;
    this.axis.width = data.width_s;
    this.showMarks();
    const kinds = [
      ["agents", "vehicle", null],
      ["targets", "target", [6, 3]],
    ];
    this.objects.show(
      kinds.flatMap(([kind, colour, dash]) => [
        ...(data.true[kind] ? [{ name: `${kind}, true`, values: data.true[kind], colour, wide: true }] : []),
        ...(data.objects[kind]
          ? [{ name: kind, values: data.objects[kind], spread: data.spread[kind], colour, dash }]
          : []),
      ]),
    );
    this.ospa.show(
      kinds
        .filter(([kind]) => data.ospa[kind])
        .map(([kind, colour, dash]) => ({ name: kind, values: data.ospa[kind], colour, dash })),
    );
    const tracks = (kind, colour) =>
      Object.entries(data.existence[kind]).map(([name, values]) => ({ name, values, colour }));
    this.targets.show(tracks("targets", "target"));
    this.agents.show(tracks("agents", "vehicle"));
    this.rate.show(this.vehicleLines(data.rate));
    this.loss.show(this.vehicleLines(data.loss));
    this.battery.show(this.vehicleLines(data.battery));
    const works = [
      ["scan", "step with a scan", "series-1", null],
      ["plan", "step with a plan", "series-2", [6, 3]],
    ];
    this.work.show(
      works
        .filter(([kind]) => data.work[kind])
        .map(([kind, name, colour, dash]) => ({ name, values: data.work[kind], colour, dash })),
    );
  }

  // Selected vehicles are on top. Colours and dashes go by number, so that they stay.
  vehicleLines(values) {
    const ids = new Map((this.feed.data.vehicles ?? []).map((one) => [one.name, one.id]));
    const names = Object.keys(values).sort((a, b) => Number(a) - Number(b));
    const chosen = names.filter((name) => this.selection.has(ids.get(name)));
    const isNamed = (name) => (chosen.length ? chosen.includes(name) : names.length <= MAX_LINES);
    const lines = names.map((name, index) => ({
      name: `vehicle ${name}`,
      tag: isNamed(name) ? name : "",
      values: values[name],
      faint: !isNamed(name),
      colour: COLOURS[index % COLOURS.length],
      dash: DASHES[Math.floor(index / COLOURS.length) % DASHES.length],
    }));
    return lines.sort((a, b) => b.faint - a.faint);
  }
}
