// What does not move: grid lines, obstacles, no-fly zones, fence, homes, rally points, fields of view.

const GRID_PX = 90;
const MAX_NAME = 24; // characters of a zone's name on the map

// Returns 1, 2 or 5 times a power of ten: the round length nearest above the given one.
export function roundLength(metres) {
  const power = 10 ** Math.floor(Math.log10(metres));
  return [1, 2, 5, 10].map((step) => step * power).find((step) => step >= metres);
}

export function gridLines(ctx, view, colour) {
  const step = roundLength(GRID_PX / view.scale);
  const [west, north] = view.place(0, 0);
  const [east, south] = view.place(view.width, view.height);
  ctx.strokeStyle = colour("map-line");
  ctx.lineWidth = 1;
  ctx.beginPath();
  for (let at = Math.ceil(west / step) * step; at < east; at += step) {
    ctx.moveTo(Math.round(view.x(at)) + 0.5, 0);
    ctx.lineTo(Math.round(view.x(at)) + 0.5, view.height);
  }
  for (let at = Math.ceil(south / step) * step; at < north; at += step) {
    ctx.moveTo(0, Math.round(view.y(at)) + 0.5);
    ctx.lineTo(view.width, Math.round(view.y(at)) + 0.5);
  }
  ctx.stroke();
}

// Obstacle cells as a small image with one pixel for each cell.
export class Obstacles {
  constructor() {
    this.image = null;
    this.map = null;
  }

  set(map, colour) {
    this.map = map;
    const [rows, columns] = map.shape;
    const bits = Uint8Array.from(atob(map.blocked), (one) => one.charCodeAt(0));
    this.image = new OffscreenCanvas(columns, rows);
    const ctx = this.image.getContext("2d");
    ctx.fillStyle = colour("obstacle");
    for (let index = 0; index < rows * columns; index++) {
      if (bits[index >> 3] & (1 << (index & 7))) {
        ctx.fillRect(index % columns, rows - 1 - Math.floor(index / columns), 1, 1);
      }
    }
  }

  draw(ctx, view) {
    if (!this.image) return;
    const {
      origin_m: [east, north],
      spacing_m: cell,
      shape: [rows, columns],
    } = this.map;
    ctx.imageSmoothingEnabled = false;
    ctx.drawImage(
      this.image,
      view.x(east - cell / 2),
      view.y(north + (rows - 0.5) * cell),
      columns * cell * view.scale,
      rows * cell * view.scale,
    );
  }
}

function ring(ctx, view, points) {
  ctx.beginPath();
  points.forEach(([east, north], index) => ctx[index ? "lineTo" : "moveTo"](view.x(east), view.y(north)));
  ctx.closePath();
}

export function border(ctx, view, mission, colour) {
  const [width, height] = mission.size_m;
  ring(ctx, view, [
    [0, 0],
    [width, 0],
    [width, height],
    [0, height],
  ]);
  ctx.strokeStyle = colour("line");
  ctx.lineWidth = 1;
  ctx.stroke();
}

export function fence(ctx, view, mission, colour) {
  ctx.lineWidth = 1.5;
  ctx.setLineDash([10, 4]);
  for (const area of mission.fence) {
    ring(ctx, view, area.ring);
    ctx.strokeStyle = colour(area.stay_in ? "done" : "warning");
    ctx.stroke();
  }
  ctx.setLineDash([]);
}

export function zones(ctx, view, closed, colour) {
  for (const zone of closed) {
    let label;
    if (zone.disc) {
      const [east, north, radius] = zone.disc;
      ctx.beginPath();
      ctx.arc(view.x(east), view.y(north), radius * view.scale, 0, 2 * Math.PI);
      label = [east, north];
    } else {
      ring(ctx, view, zone.polygon);
      label = [0, 1].map(
        (axis) => zone.polygon.reduce((sum, point) => sum + point[axis], 0) / zone.polygon.length,
      );
    }
    ctx.fillStyle = ctx.strokeStyle = colour("warning");
    ctx.globalAlpha = 0.16;
    ctx.fill();
    ctx.globalAlpha = 1;
    ctx.lineWidth = 1.5;
    ctx.stroke();
    ctx.textAlign = "center";
    ctx.fillText(
      zone.name.length > MAX_NAME ? `${zone.name.slice(0, MAX_NAME)}…` : zone.name,
      view.x(label[0]),
      view.y(label[1]) + 4,
    );
  }
}

export function homes(ctx, view, mission, colour) {
  ctx.strokeStyle = ctx.fillStyle = colour("dim");
  ctx.lineWidth = 1.2;
  for (const { at } of mission.homes) {
    const [x, y] = [view.x(at[0]), view.y(at[1])];
    ctx.beginPath();
    ctx.moveTo(x - 5, y);
    ctx.lineTo(x, y - 5);
    ctx.lineTo(x + 5, y);
    ctx.moveTo(x - 3.5, y);
    ctx.lineTo(x - 3.5, y + 4);
    ctx.lineTo(x + 3.5, y + 4);
    ctx.lineTo(x + 3.5, y);
    ctx.stroke();
  }
  ctx.textAlign = "center";
  for (const at of mission.rally) ctx.fillText("R", view.x(at[0]), view.y(at[1]) + 4);
}

export function fieldsOfView(ctx, view, sensors, colour) {
  ctx.strokeStyle = colour("detection");
  ctx.globalAlpha = 0.5;
  ctx.lineWidth = 1;
  for (const one of Object.values(sensors)) {
    if (one.box) {
      const [west, south, east, north] = one.box;
      ring(ctx, view, [
        [west, south],
        [east, south],
        [east, north],
        [west, north],
      ]);
    } else {
      sector(ctx, view, one);
    }
    ctx.stroke();
  }
  ctx.globalAlpha = 1;
}

function sector(ctx, view, { at, range_m: [near, far], bearing_rad: [centre, half] }) {
  const [x, y] = [view.x(at[0]), view.y(at[1])];
  const turn = -Math.PI / 2; // bearings are clockwise from north, canvas angles clockwise from east
  ctx.beginPath();
  ctx.arc(x, y, far * view.scale, centre - half + turn, centre + half + turn);
  if (half < Math.PI) ctx.arc(x, y, near * view.scale, centre + half + turn, centre - half + turn, true);
  ctx.closePath();
}
