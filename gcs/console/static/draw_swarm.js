// What moves: trails, routes, tracks, targets, vehicles.

const SIGMAS = 3;
const MIN_INNER_PX = 5; // of the ellipse of one standard deviation
const IGNORED = 0.45; // opacity
const SIZE = 6; // of a target's diamond, which hides smaller ellipses

export function trails(ctx, view, tracks, colour) {
  ctx.strokeStyle = colour("vehicle");
  ctx.lineWidth = 1.2;
  ctx.globalAlpha = 0.45;
  ctx.beginPath();
  for (const points of tracks.values()) line(ctx, view, points);
  ctx.stroke();
  ctx.globalAlpha = 1;
}

// A gap in the data is null: the line ends there, and begins again.
function line(ctx, view, points) {
  let isBegun = false;
  for (const point of points) {
    if (point) ctx[isBegun ? "lineTo" : "moveTo"](view.x(point[0]), view.y(point[1]));
    isBegun = Boolean(point);
  }
}

export function routes(ctx, view, planned, style) {
  ctx.strokeStyle = style.colour;
  for (const route of planned) {
    ctx.setLineDash(style.dash ?? []);
    ctx.lineWidth = style.width;
    ctx.globalAlpha = style.selected.size && !style.selected.has(route.id) ? 0.35 : 0.9;
    ctx.beginPath();
    const one = style.from.get(route.id);
    line(
      ctx,
      view,
      one ? [one.at, ...route.points.slice(Math.min(one.passed, route.points.length - 1))] : route.points,
    );
    ctx.stroke();
    meeting(ctx, view, route, style.loiter[route.id]);
  }
  ctx.setLineDash([]);
  ctx.globalAlpha = 1;
}

// Where vehicle and target will meet, and the circle that follows.
function meeting(ctx, view, route, radius) {
  const [east, north] = route.points.at(-1);
  ctx.lineWidth = 1.2;
  ctx.setLineDash([]);
  ctx.beginPath();
  ctx.arc(view.x(east), view.y(north), 3, 0, 2 * Math.PI);
  ctx.stroke();
  const centre = route.wait ?? [east, north];
  if (radius * view.scale < 6) return;
  ctx.setLineDash([2, 3]);
  ctx.beginPath();
  ctx.arc(view.x(centre[0]), view.y(centre[1]), radius * view.scale, 0, 2 * Math.PI);
  ctx.stroke();
  ctx.setLineDash([]);
}

// Of one and of three standard deviations.
function ellipses(ctx, view, mean, [xx, xy, yy]) {
  const middle = (xx + yy) / 2;
  const spread = Math.hypot((xx - yy) / 2, xy);
  const turn = -0.5 * Math.atan2(2 * xy, xx - yy); // the canvas' y axis points south
  const [x, y] = [view.x(mean[0]), view.y(mean[1])];
  ctx.beginPath();
  for (const sigmas of [SIGMAS, 1]) {
    const radius = (variance) =>
      Math.min(4000, Math.max(1.5, sigmas * Math.sqrt(Math.max(variance, 0)) * view.scale));
    const [a, b] = [radius(middle + spread), radius(middle - spread)];
    if (sigmas === 1 && a < MIN_INNER_PX) return;
    ctx.moveTo(x + a * Math.cos(turn), y + a * Math.sin(turn));
    ctx.ellipse(x, y, a, b, turn, 0, 2 * Math.PI);
  }
}

const largest = ([xx, , yy], view) => SIGMAS * Math.sqrt(Math.max(xx, yy)) * view.scale;

const opacity = (existence) => 0.2 + 0.8 * existence;

export function agentTracks(ctx, view, tracks, colour) {
  ctx.strokeStyle = colour("vehicle");
  ctx.lineWidth = 1;
  tracks.names.forEach((_, index) => {
    if (!tracks.estimated[index]) return;
    ctx.globalAlpha = 0.8 * opacity(tracks.existence[index]);
    ellipses(ctx, view, tracks.means[index], tracks.covs[index]);
    ctx.stroke();
  });
  ctx.globalAlpha = 1;
}

export function targetTracks(ctx, view, tracks, confirmed, labels, colour, options) {
  ctx.lineWidth = 1.4;
  ctx.textAlign = "left";
  tracks.names.forEach((name, index) => {
    const target = confirmed.get(name);
    if (!target && !(options.tentative && tracks.estimated[index])) return;
    const [x, y] = [view.x(tracks.means[index][0]), view.y(tracks.means[index][1])];
    if (x < -50 || y < -50 || x > view.width + 50 || y > view.height + 50) return;
    const isSelected = options.selected === name;
    if (isSelected) halo(ctx, x, y, colour("advisory"));
    ctx.globalAlpha = target?.ignored ? IGNORED : opacity(tracks.existence[index]);
    ctx.strokeStyle = ctx.fillStyle = colour(target?.reached_by.length ? "done" : "target");
    if (options.ellipses && !target?.ignored && largest(tracks.covs[index], view) > SIZE) {
      ctx.lineWidth = 1;
      ellipses(ctx, view, tracks.means[index], tracks.covs[index]);
      ctx.stroke();
    }
    ctx.lineWidth = 1.6;
    diamond(ctx, x, y, SIZE);
    if (target?.agents.length || target?.reached_by.length) ctx.fill();
    ctx.stroke();
    if (target?.ignored) stroke(ctx, [x - 10, y + 7], [x + 10, y - 7]);
    if (options.labels || isSelected)
      labels.draw(label(name, target), x + 9, y + 4, isSelected, target?.ignored);
  });
  ctx.globalAlpha = 1;
}

function label(name, target) {
  if (!target) return name;
  const rank = target.priority === null ? "" : ` p${target.priority}`;
  return name + (target.reached_by.length ? " ✓" : "") + (target.ignored ? "" : rank);
}

function stroke(ctx, [x0, y0], [x1, y1]) {
  ctx.beginPath();
  ctx.moveTo(x0, y0);
  ctx.lineTo(x1, y1);
  ctx.stroke();
}

// Dotted lines from vehicles to the targets that they are pinned to.
export function pins(ctx, view, list, targets, colour) {
  ctx.strokeStyle = colour("advisory");
  ctx.lineWidth = 1.5;
  ctx.setLineDash([2, 4]);
  for (const { at, status, pinned } of list) {
    const target = targets.get(pinned);
    if (at && target && status === "active")
      stroke(ctx, [view.x(at[0]), view.y(at[1])], [view.x(target.at[0]), view.y(target.at[1])]);
  }
  ctx.setLineDash([]);
}

function diamond(ctx, x, y, size) {
  ctx.beginPath();
  ctx.moveTo(x, y - size);
  ctx.lineTo(x + size, y);
  ctx.lineTo(x, y + size);
  ctx.lineTo(x - size, y);
  ctx.closePath();
}

export function vehicles(ctx, view, list, selection, labels, colour, options) {
  ctx.textAlign = "left";
  ctx.font = `600 ${options.font}`;
  for (const vehicle of list) {
    if (["lost", "down"].includes(vehicle.status)) {
      if (vehicle.lost_at) cross(ctx, view, vehicle, labels, colour("warning"));
      continue;
    }
    if (!vehicle.at) continue;
    const [x, y] = [view.x(vehicle.at[0]), view.y(vehicle.at[1])];
    const tint = tintOf(vehicle);
    ctx.fillStyle = ctx.strokeStyle = colour(tint);
    if (selection.has(vehicle.id)) halo(ctx, x, y, colour("advisory"));
    ctx.fillStyle = colour(tint);
    arrow(ctx, x, y, vehicle.course);
    if (vehicle.late)
      ctx.stroke(); // hollow: its position is old
    else ctx.fill();
    labels.draw(vehicle.name, x + 10, y - 5, tint !== "vehicle" || selection.has(vehicle.id));
  }
  ctx.font = options.font;
}

export function altitudes(ctx, view, list, labels, colour) {
  ctx.textAlign = "left";
  ctx.fillStyle = colour("dim");
  for (const { at, alt_m, status } of list) {
    if (at && alt_m !== null && status !== "lost")
      labels.draw(`${alt_m.toFixed(0)} m`, view.x(at[0]) + 10, view.y(at[1]) + 9);
  }
}

function tintOf(vehicle) {
  if (vehicle.doubted) return "warning";
  if (vehicle.late || vehicle.authority !== "ours") return "caution";
  return vehicle.status === "arrived" ? "done" : "vehicle";
}

function arrow(ctx, x, y, course) {
  const [sin, cos] = [Math.sin(course ?? 0), Math.cos(course ?? 0)];
  const point = (right, forward) => [x + right * cos + forward * sin, y + right * sin - forward * cos];
  ctx.lineWidth = 1.5;
  ctx.beginPath();
  ctx.moveTo(...point(0, 10));
  ctx.lineTo(...point(6, -6));
  ctx.lineTo(...point(0, -3));
  ctx.lineTo(...point(-6, -6));
  ctx.closePath();
}

function halo(ctx, x, y, tint) {
  ctx.strokeStyle = tint;
  ctx.lineWidth = 2;
  ctx.beginPath();
  ctx.arc(x, y, 14, 0, 2 * Math.PI);
  ctx.stroke();
}

function cross(ctx, view, vehicle, labels, tint) {
  const [x, y] = [view.x(vehicle.lost_at[0]), view.y(vehicle.lost_at[1])];
  ctx.strokeStyle = ctx.fillStyle = tint;
  ctx.lineWidth = 2;
  ctx.beginPath();
  ctx.moveTo(x - 6, y - 6);
  ctx.lineTo(x + 6, y + 6);
  ctx.moveTo(x + 6, y - 6);
  ctx.lineTo(x - 6, y + 6);
  ctx.stroke();
  labels.draw(`${vehicle.name} lost`, x + 10, y + 4, true);
}
