// Picture of the map: which drawings are in it, and in which order.

/**
 * @import { MissionDetail, MissionInfo } from "../page_types.d.ts"
 * @import { Context } from "./canvas.js"
 * @import { FeedData } from "./feed.js"
 * @import { LayerName } from "./map_layers.js"
 * @import { Selection } from "./selection.js"
 * @import { Theme } from "./theme.js"
 * @import { View } from "./map_view.js"
 */

import { FAMILY } from "./canvas.js";
import { Detections } from "./draw_detections.js";
import * as ground from "./draw_ground.js";
import { drawOnboardMission } from "./draw_mission.js";
import * as swarm from "./draw_swarm.js";
import { drawAgentTracks, drawTargets } from "./draw_tracks.js";
import { targetName } from "./format.js";
import { TerrainPicture } from "./ground_picture.js";
import { LateTracks } from "./late_tracks.js";
import { Labels } from "./map_labels.js";
import { Tiles } from "./map_tiles.js";
import { Trails } from "./trails.js";

const FONT = `12px ${FAMILY}`;
const TILES_OPACITY = 0.4; // so that what is drawn above keeps its contrast

export class MapPicture {
  /**
   * @param {Context} ctx
   * @param {View} view
   * @param {Selection} selection
   * @param {Theme} theme
   * @param {() => void} redraw
   */
  constructor(ctx, view, selection, theme, redraw) {
    this.ctx = ctx;
    this.view = view;
    this.selection = selection;
    this.theme = theme;
    this.obstacles = new ground.Obstacles();
    this.terrain = new TerrainPicture();
    this.trails = new Trails();
    this.late = new LateTracks();
    this.detections = new Detections();
    this.tiles = new Tiles(redraw);
    /** @type {MissionDetail | null} */
    this.onboard = null;
  }

  /**
   * Draw what the feed has brought.
   *
   * @param {FeedData} data
   * @param {MissionInfo} mission
   * @param {Record<LayerName, boolean>} layers
   */
  draw(data, mission, layers) {
    this.drawGround(data, mission, layers);
    this.drawMoving(data, mission, layers);
  }

  /**
   * @param {FeedData} data
   * @param {MissionInfo} mission
   * @param {Record<LayerName, boolean>} layers
   */
  drawGround(data, mission, layers) {
    const { ctx, view } = this;
    const { colour } = this.theme;
    ctx.fillStyle = colour("map");
    ctx.fillRect(0, 0, view.width, view.height);
    ctx.font = FONT;
    if (layers.terrain) this.terrain.draw(ctx, view, colour);
    if (layers.tiles) this.drawTiles(mission);
    ground.drawGridLines(ctx, view, colour);
    this.obstacles.draw(ctx, view);
    ground.drawBorder(ctx, view, mission, colour);
    ground.drawZones(ctx, view, data.zones, colour);
    if (layers.fence) {
      ground.drawFence(ctx, view, mission, colour);
      ground.drawHomes(ctx, view, mission, colour);
    }
    if (layers.views) ground.drawFieldsOfView(ctx, view, Object.values(data.fields_of_view ?? {}), colour);
  }

  /**
   * @param {FeedData} data
   * @param {MissionInfo} mission
   * @param {Record<LayerName, boolean>} layers
   */
  drawMoving(data, mission, layers) {
    const { ctx, view, selection } = this;
    const { colour } = this.theme;
    const targets = new Map(data.targets.map((one) => [targetName(one.label), one]));
    const labels = new Labels(ctx);
    if (layers.detections && !this.detections.isEmpty) this.detections.draw(ctx, view, colour("detection"));
    if (layers.trails) swarm.drawTrails(ctx, view, this.trails.all(), colour);
    if (layers.late && mission.lag_scans) this.late.draw(ctx, view, colour);
    if (layers.routes) this.drawRoutes(data, mission);
    if (layers.ellipses && data.agents_tracks) drawAgentTracks(ctx, view, data.agents_tracks, colour);
    if (this.onboard) drawOnboardMission(ctx, view, this.onboard, labels, colour);
    swarm.drawPins(ctx, view, data.vehicles, targets, colour);
    swarm.drawVehicles(ctx, view, data.vehicles, selection, labels, colour);
    if (data.targets_tracks) {
      const style = { ...layers, selected: selection.target };
      drawTargets(ctx, view, data.targets_tracks, targets, labels, colour, style);
    }
    if (layers.altitudes) swarm.drawAltitudes(ctx, view, data.vehicles, labels, colour);
  }

  /** @param {MissionInfo} mission */
  drawTiles(mission) {
    if (!mission.tiles) return;
    const { ctx, view } = this;
    ctx.globalAlpha = TILES_OPACITY;
    this.tiles.draw(ctx, view, mission.tiles, mission);
    ctx.globalAlpha = 1;
    ctx.fillStyle = this.theme.colour("dim");
    ctx.textAlign = "left";
    ctx.fillText(mission.tiles.attribution.replace(/<[^>]*>/g, ""), 12, view.height - 34);
  }

  /**
   * Draw the routes that are flown, from the vehicles on, and those that wait for approval.
   *
   * @param {FeedData} data
   * @param {MissionInfo} mission
   */
  drawRoutes({ vehicles, routes, proposal }, mission) {
    const { ctx, view } = this;
    const { colour } = this.theme;
    const active = vehicles.filter((one) => one.status === "active");
    const common = { selected: this.selection.ids, loiter: mission.loiter_radii_m };
    swarm.drawRoutes(ctx, view, routes, active, { ...common, colour: colour("route"), width: 1.5, dash: [] });
    if (!proposal) return;
    const waiting = active.map((one) => ({ ...one, points_passed: 0 }));
    const dashed = { ...common, colour: colour("caution"), width: 2, dash: [8, 5] };
    swarm.drawRoutes(ctx, view, proposal.routes, waiting, dashed);
  }
}
