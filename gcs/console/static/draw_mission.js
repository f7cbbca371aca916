// Onboard mission of the vehicle whose details are shown: items with their numbers, the current one filled.

const SIZE = 4;

export function onboardMission(ctx, view, mission, labels, colour) {
  const placed = mission.items.filter(
    ({ at, seq }) => at && seq >= Math.min(mission.first, mission.current ?? mission.first),
  );
  ctx.strokeStyle = ctx.fillStyle = colour("advisory");
  ctx.lineWidth = 1.5;
  ctx.setLineDash([6, 3]);
  ctx.beginPath();
  placed.forEach(({ at }, index) => ctx[index ? "lineTo" : "moveTo"](view.x(at[0]), view.y(at[1])));
  ctx.stroke();
  ctx.setLineDash([]);
  ctx.textAlign = "left";
  for (const { seq, at } of placed) {
    const [x, y] = [view.x(at[0]), view.y(at[1])];
    ctx[seq === mission.current ? "fillRect" : "strokeRect"](x - SIZE, y - SIZE, 2 * SIZE, 2 * SIZE);
    labels.draw(String(seq), x + 8, y - 6);
  }
}
