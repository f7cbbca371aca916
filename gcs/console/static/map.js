// Map: canvas, layers, and what is drawn in which order.

import { Detections } from "./detections.js";
import { el } from "./dom.js";
import * as ground from "./draw_ground.js";
import { onboardMission } from "./draw_mission.js";
import * as swarm from "./draw_swarm.js";
import { metres } from "./format.js";
import { Labels } from "./labels.js";
import { Pointer } from "./pointer.js";
import { Tiles } from "./tiles.js";
import { View } from "./view.js";

const FONT = '12px system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif';
const FADE_STEP_MS = 250;
const TILES_OPACITY = 0.4;
const MAX_TRAIL = 1500;
const TRAIL_STEP_M = 5;
const LAYERS = {
  tiles: "Map tiles",
  trails: "Trails",
  routes: "Routes",
  ellipses: "Tracked ellipses (1σ, 3σ)",
  detections: "Detections",
  altitudes: "Altitudes",
  labels: "Target labels",
  tentative: "Unconfirmed targets",
  views: "Fields of view",
  fence: "Fence and homes",
};

const HIDDEN = new Set(["views", "tentative"]); // until the user shows them

export class SwarmMap {
  constructor(root, feed, selection, theme) {
    this.root = root;
    this.feed = feed;
    this.selection = selection;
    this.theme = theme;
    this.view = new View();
    this.obstacles = new ground.Obstacles();
    this.trails = new Map();
    this.detections = new Detections();
    this.tiles = new Tiles(() => this.redraw());
    this.tool = null;
    this.mission = null; // onboard mission that is shown
    this.follows = false;
    this.isMoved = false;
    const shown = Object.keys(LAYERS).map((name) => [name, !HIDDEN.has(name)]);
    this.layers = { ...Object.fromEntries(shown), ...JSON.parse(localStorage.getItem("layers") ?? "{}") };
    this.build();
    this.listen();
  }

  build() {
    this.canvas = el("canvas", {
      role: "img",
      "aria-label": "Map of vehicles, targets and routes; the tables have the same data",
    });
    this.ctx = this.canvas.getContext("2d", { alpha: false });
    this.place = el("div", { class: "place" });
    this.hint = el("div", { class: "hint", hidden: true });
    this.panel = el(
      "div",
      { class: "layers", hidden: true },
      ...Object.entries(LAYERS).map(([name, text]) => {
        const box = el("input", { type: "checkbox", onchange: () => this.setLayer(name, box.checked) });
        box.checked = this.layers[name];
        return el("label", {}, box, text);
      }),
    );
    const button = (text, key, action, title) =>
      el("button", { title: `${title} (${key})`, onclick: action }, text);
    this.followButton = button(
      "Follow",
      "F",
      () => this.follow(),
      "Keep the selected vehicles, or the swarm, in view",
    );
    this.layersButton = button("Layers", "L", () => this.toggleLayers(), "Choose what is drawn");
    this.tools = el(
      "div",
      { class: "tools" },
      button("+", "+", () => this.zoom(1.4), "Zoom in"),
      button("−", "-", () => this.zoom(1 / 1.4), "Zoom out"),
      button("Swarm", "Z", () => this.fitSwarm(), "Zoom to the swarm"),
      button("All", "0", () => this.fitAll(), "Zoom to the mission's area"),
      this.followButton,
      this.layersButton,
      button("Measure", "M", () => this.onmeasure?.(), "Measure a distance"),
    );
    this.root.append(this.canvas, this.tools, this.panel, this.hint, this.place);
  }

  listen() {
    new ResizeObserver(() => this.resize()).observe(this.canvas);
    this.theme.addEventListener("change", () => {
      if (this.obstacles.map) this.obstacles.set(this.obstacles.map, this.theme.colour);
      this.redraw();
    });
    this.selection.addEventListener("change", () => this.redraw());
    this.feed.on(["map"], ({ map }) => this.obstacles.set(map, this.theme.colour));
    this.feed.on(["vehicles"], ({ vehicles }) => this.move(vehicles));
    this.feed.on(["scans"], ({ scans }) => this.detections.add(scans));
    this.feed.addEventListener("data", (event) => {
      if (event.detail.fresh) this.begin();
      this.redraw();
    });
    new Pointer(this);
  }

  begin() {
    this.detections.clear();
    this.trails.clear();
    for (const [id, points] of Object.entries(this.feed.data.trails)) this.trails.set(Number(id), points);
    const run = `${this.feed.data.mission.name} ${this.feed.data.mission.begun}`;
    if (run === this.run) return;
    this.run = run;
    this.fitAll();
  }

  say(text, actions = []) {
    this.hint.replaceChildren(
      text ?? "",
      ...actions.map(([label, act]) => el("button", { onclick: act }, label)),
    );
    this.hint.hidden = !text;
    this.hint.querySelector("button")?.focus();
  }

  // A tool takes the pointer until it ends. See tools.js.
  use(tool) {
    this.tool = tool;
    this.say(tool?.hint, tool?.actions);
    this.redraw();
  }

  setMission(mission) {
    this.mission = mission;
    this.redraw();
  }

  move(vehicles) {
    for (const { id, at, late, status } of vehicles) {
      const trail = this.trails.get(id) ?? [];
      if (late && trail.at(-1)) trail.push(null); // where it flies now is not known
      if (!at || late || status === "lost") continue;
      const last = trail.at(-1);
      if (!last || Math.hypot(at[0] - last[0], at[1] - last[1]) > TRAIL_STEP_M) trail.push(at);
      if (trail.length > MAX_TRAIL) trail.shift();
      this.trails.set(id, trail);
    }
    if (this.follows) this.centreSwarm();
  }

  setLayer(name, isShown) {
    this.layers[name] = isShown;
    localStorage.setItem("layers", JSON.stringify(this.layers));
    this.redraw();
  }

  toggleLayers() {
    this.panel.hidden = !this.panel.hidden;
    this.layersButton.setAttribute("aria-pressed", String(!this.panel.hidden));
    if (!this.panel.hidden) this.panel.querySelector("input").focus();
  }

  pan(dx, dy) {
    this.view.pan(dx, dy);
    this.moved();
  }

  zoom(factor, x, y) {
    this.view.zoom(factor, x, y);
    this.moved();
  }

  moved(isMoved = true) {
    this.isMoved = isMoved;
    this.redraw();
    this.onmove?.();
  }

  // Shows what another map shows.
  look(east, north, scale) {
    this.setFollows(false);
    Object.assign(this.view, { east, north, scale });
    this.isMoved = true;
    this.redraw();
  }

  places() {
    const vehicles = this.feed.data.vehicles ?? [];
    const chosen = this.selection.among(vehicles);
    return (chosen.length ? chosen : vehicles)
      .filter((one) => one.at && one.status !== "lost")
      .map((one) => one.at);
  }

  fitSwarm() {
    const targets = this.selection.ids.size ? [] : (this.feed.data.targets ?? []).map((one) => one.at);
    this.view.fit([...this.places(), ...targets], 60);
    this.moved();
  }

  fitAll() {
    const [width, height] = this.feed.data.mission?.size_m ?? [1000, 1000];
    this.view.fit(
      [
        [0, 0],
        [width, height],
      ],
      24,
    );
    this.moved(false);
  }

  follow() {
    this.setFollows(!this.follows);
    this.centreSwarm();
  }

  setFollows(follows) {
    this.follows = follows;
    this.followButton.setAttribute("aria-pressed", String(follows));
  }

  centreSwarm() {
    const places = this.places();
    if (places.length)
      this.centre([0, 1].map((axis) => places.reduce((sum, at) => sum + at[axis], 0) / places.length));
  }

  // Moves the map only if a place is out of view.
  show(place) {
    const [x, y] = [this.view.x(place[0]), this.view.y(place[1])];
    if (x < 0 || y < 0 || x > this.view.width || y > this.view.height) this.centre(place);
  }

  centre([east, north]) {
    Object.assign(this.view, { east, north });
    this.moved();
  }

  resize() {
    const ratio = window.devicePixelRatio || 1;
    const { clientWidth, clientHeight } = this.canvas;
    this.canvas.width = Math.round(clientWidth * ratio);
    this.canvas.height = Math.round(clientHeight * ratio);
    this.view.width = clientWidth;
    this.view.height = clientHeight;
    this.ratio = ratio;
    if (!this.isMoved && this.feed.data.mission) this.fitAll();
    this.draw();
  }

  redraw() {
    this.frame ??= requestAnimationFrame(() => {
      this.frame = null;
      this.draw();
    });
  }

  draw() {
    const { ctx, view, layers } = this;
    const { colour } = this.theme;
    const { mission, vehicles = [], targets = [], routes = [], zones = [], proposal } = this.feed.data;
    if (!mission || !this.ratio) return;
    ctx.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    ctx.fillStyle = colour("map");
    ctx.fillRect(0, 0, view.width, view.height);
    ctx.font = FONT;
    if (mission.tiles && layers.tiles) this.drawTiles(mission);
    ground.gridLines(ctx, view, colour);
    this.obstacles.draw(ctx, view);
    ground.border(ctx, view, mission, colour);
    ground.zones(ctx, view, zones, colour);
    if (layers.fence) {
      ground.fence(ctx, view, mission, colour);
      ground.homes(ctx, view, mission, colour);
    }
    if (layers.views) ground.fieldsOfView(ctx, view, this.feed.data.fields_of_view ?? {}, colour);
    if (layers.detections && !this.detections.isEmpty) this.detections.draw(ctx, view, colour("detection"));
    if (layers.trails) swarm.trails(ctx, view, this.trails, colour);
    if (layers.routes) this.drawRoutes(vehicles, routes, proposal, mission);
    if (layers.ellipses && this.feed.data.agents_tracks)
      swarm.agentTracks(ctx, view, this.feed.data.agents_tracks, colour);
    const confirmed = new Map(targets.map((one) => [one.name, one]));
    const labels = new Labels(ctx);
    if (this.mission) onboardMission(ctx, view, this.mission, labels, colour);
    swarm.pins(ctx, view, vehicles, confirmed, colour);
    swarm.vehicles(ctx, view, vehicles, this.selection, labels, colour, { font: FONT });
    if (this.feed.data.targets_tracks)
      swarm.targetTracks(ctx, view, this.feed.data.targets_tracks, confirmed, labels, colour, {
        ...layers,
        selected: this.selection.target,
      });
    if (layers.altitudes) swarm.altitudes(ctx, view, vehicles, labels, colour);
    this.tool?.draw(ctx, view, colour);
    this.drawBox();
    this.drawScale();
    this.fade();
  }

  // Faint, so that what is drawn above keeps its contrast.
  drawTiles(mission) {
    this.ctx.globalAlpha = TILES_OPACITY;
    this.tiles.draw(this.ctx, this.view, mission);
    this.ctx.globalAlpha = 1;
    const credit = mission.tiles.attribution.replace(/<[^>]*>/g, "");
    this.ctx.fillStyle = this.theme.colour("dim");
    this.ctx.textAlign = "left";
    this.ctx.fillText(credit, 12, this.view.height - 34);
  }

  fade() {
    if (!this.layers.detections || this.detections.isEmpty) return;
    this.fading ??= setTimeout(() => {
      this.fading = null;
      this.redraw();
    }, FADE_STEP_MS);
  }

  drawRoutes(vehicles, routes, proposal, mission) {
    const { colour } = this.theme;
    const from = new Map(
      vehicles.filter((one) => one.at && one.status === "active").map((one) => [one.id, one]),
    );
    const waiting = new Map([...from].map(([id, one]) => [id, { ...one, passed: 0 }]));
    const common = { from, selected: this.selection.ids, loiter: mission.loiter_radii_m };
    swarm.routes(this.ctx, this.view, routes, { ...common, colour: colour("route"), width: 1.5 });
    if (proposal)
      swarm.routes(this.ctx, this.view, proposal.routes, {
        ...common,
        from: waiting,
        colour: colour("caution"),
        width: 2,
        dash: [8, 5],
      });
  }

  drawBox() {
    if (!this.box) return;
    const [x0, y0, x1, y1] = this.box;
    this.ctx.strokeStyle = this.theme.colour("advisory");
    this.ctx.lineWidth = 1;
    this.ctx.strokeRect(x0, y0, x1 - x0, y1 - y0);
  }

  drawScale() {
    const { ctx, view } = this;
    const length = ground.roundLength(60 / view.scale);
    const [x, y, width] = [12, view.height - 12, length * view.scale];
    ctx.strokeStyle = ctx.fillStyle = this.theme.colour("dim");
    ctx.lineWidth = 1.5;
    ctx.beginPath();
    ctx.moveTo(x, y - 5);
    ctx.lineTo(x, y);
    ctx.lineTo(x + width, y);
    ctx.lineTo(x + width, y - 5);
    ctx.stroke();
    ctx.textAlign = "left";
    ctx.fillText(metres(length), x + 4, y - 5);
  }
}
