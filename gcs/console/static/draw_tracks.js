// Drawing of tracks: ellipses of agents, and targets.

/**
 * @import { Covariance, TargetRecord, Tracks } from "../page_types.d.ts"
 * @import { Colour, Context } from "./canvas.js"
 * @import { Labels } from "./map_labels.js"
 * @import { View } from "./map_view.js"
 *
 * @typedef {object} TargetStyle
 * @property {boolean} ellipses
 * @property {boolean} labels
 * @property {boolean} tentative draw unconfirmed targets, too
 * @property {string | null} selected
 */

import { strokeLine } from "./canvas.js";
import { drawHalo } from "./draw_swarm.js";

const SIGMAS = 3;
const MIN_INNER_PX = 5; // of the ellipse of one standard deviation
const MIN_RADIUS_PX = 1.5;
const MAX_RADIUS_PX = 4000;
const IGNORED = 0.45; // opacity
const SIZE = 6; // of a target's diamond, which hides smaller ellipses
const OUTSIDE_PX = 50;

/** @param {number} existence */
const opacity = (existence) => 0.2 + 0.8 * existence;

/**
 * @param {Context} ctx
 * @param {View} view
 * @param {Tracks} tracks
 * @param {Colour} colour
 */
export function drawAgentTracks(ctx, view, tracks, colour) {
  ctx.strokeStyle = colour("vehicle");
  ctx.lineWidth = 1;
  tracks.means.forEach(([east, north], index) => {
    if (!tracks.estimated[index]) return;
    ctx.globalAlpha = 0.8 * opacity(tracks.existence[index]);
    strokeEllipses(ctx, view.x(east), view.y(north), tracks.covs[index], view.scale);
  });
  ctx.globalAlpha = 1;
}

/**
 * @param {Context} ctx
 * @param {View} view
 * @param {Tracks} tracks
 * @param {Map<string, TargetRecord>} confirmed
 * @param {Labels} labels
 * @param {Colour} colour
 * @param {TargetStyle} style
 */
export function drawTargets(ctx, view, tracks, confirmed, labels, colour, style) {
  ctx.textAlign = "left";
  tracks.names.forEach((name, index) => {
    const target = confirmed.get(name);
    if (!target && !(style.tentative && tracks.estimated[index])) return;
    const [east, north] = tracks.means[index];
    const [x, y] = [view.x(east), view.y(north)];
    if (x < -OUTSIDE_PX || y < -OUTSIDE_PX || x > view.width + OUTSIDE_PX || y > view.height + OUTSIDE_PX)
      return;
    const isSelected = style.selected === name;
    const isIgnored = target?.is_ignored ?? false;
    const isReached = Boolean(target?.reached_by.length);
    const cov = tracks.covs[index];
    if (isSelected) drawHalo(ctx, x, y, colour("advisory"));
    ctx.globalAlpha = isIgnored ? IGNORED : opacity(tracks.existence[index]);
    ctx.strokeStyle = ctx.fillStyle = colour(isReached ? "done" : "target");
    ctx.lineWidth = 1;
    if (style.ellipses && !isIgnored && largest(cov) * view.scale > SIZE)
      strokeEllipses(ctx, x, y, cov, view.scale);
    ctx.lineWidth = 1.6;
    beginDiamond(ctx, x, y);
    if (isReached || target?.agents.length) ctx.fill();
    ctx.stroke();
    if (isIgnored) {
      strokeLine(ctx, [
        [x - 10, y + 7],
        [x + 10, y - 7],
      ]);
    }
    if (style.labels || isSelected) labels.draw(labelOf(name, target), x + 9, y + 4, isSelected, isIgnored);
  });
  ctx.globalAlpha = 1;
}

/** @param {Covariance} cov */
const largest = ([xx, , yy]) => SIGMAS * Math.sqrt(Math.max(xx, yy));

/**
 * Draw the ellipses of one and of three standard deviations.
 *
 * @param {Context} ctx
 * @param {number} x
 * @param {number} y
 * @param {Covariance} cov
 * @param {number} scale pixels per metre
 */
function strokeEllipses(ctx, x, y, [xx, xy, yy], scale) {
  const middle = (xx + yy) / 2;
  const spread = Math.hypot((xx - yy) / 2, xy);
  const turn = -0.5 * Math.atan2(2 * xy, xx - yy); // the canvas' y axis points south
  ctx.beginPath();
  for (const sigmas of [SIGMAS, 1]) {
    const a = radius(sigmas, middle + spread, scale);
    const b = radius(sigmas, middle - spread, scale);
    if (sigmas === 1 && a < MIN_INNER_PX) break;
    ctx.moveTo(x + a * Math.cos(turn), y + a * Math.sin(turn));
    ctx.ellipse(x, y, a, b, turn, 0, 2 * Math.PI);
  }
  ctx.stroke();
}

/**
 * @param {number} sigmas
 * @param {number} variance
 * @param {number} scale
 */
function radius(sigmas, variance, scale) {
  const length = sigmas * Math.sqrt(Math.max(variance, 0)) * scale;
  return Math.min(MAX_RADIUS_PX, Math.max(MIN_RADIUS_PX, length));
}

/**
 * @param {string} name
 * @param {TargetRecord | undefined} target
 */
function labelOf(name, target) {
  if (!target) return name;
  const rank = target.priority === null || target.is_ignored ? "" : ` p${target.priority}`;
  return name + (target.reached_by.length ? " ✓" : "") + rank;
}

/**
 * @param {Context} ctx
 * @param {number} x
 * @param {number} y
 */
function beginDiamond(ctx, x, y) {
  ctx.beginPath();
  ctx.moveTo(x, y - SIZE);
  ctx.lineTo(x + SIZE, y);
  ctx.lineTo(x, y + SIZE);
  ctx.lineTo(x - SIZE, y);
  ctx.closePath();
}
