// Drawing of the onboard mission of the vehicle whose details are shown: numbered items, the current one filled.

/**
 * @import { MissionDetail, Point } from "../page_types.d.ts"
 * @import { Colour, Context } from "./canvas.js"
 * @import { Labels } from "./map_labels.js"
 * @import { View } from "./map_view.js"
 */

import { addLine } from "./canvas.js";

const SIZE = 4;

/**
 * @param {Context} ctx
 * @param {View} view
 * @param {MissionDetail} mission
 * @param {Labels} labels
 * @param {Colour} colour
 */
export function drawOnboardMission(ctx, view, mission, labels, colour) {
  const first = Math.min(mission.first, mission.current ?? mission.first);
  /** @type {{ seq: number, at: Point }[]} */
  const placed = mission.items.flatMap(({ at, seq }) => (at && seq >= first ? [{ seq, at }] : []));
  ctx.strokeStyle = ctx.fillStyle = colour("advisory");
  ctx.lineWidth = 1.5;
  ctx.setLineDash([6, 3]);
  ctx.beginPath();
  addLine(
    ctx,
    view,
    placed.map(({ at }) => at),
  );
  ctx.stroke();
  ctx.setLineDash([]);
  ctx.textAlign = "left";
  for (const { seq, at } of placed) {
    const [x, y] = [view.x(at[0]), view.y(at[1])];
    if (seq === mission.current) ctx.fillRect(x - SIZE, y - SIZE, 2 * SIZE, 2 * SIZE);
    else ctx.strokeRect(x - SIZE, y - SIZE, 2 * SIZE, 2 * SIZE);
    labels.draw(String(seq), x + 8, y - 6);
  }
}
