// View of the map: east/north metres to pixels and back. North is up.

const MIN_SCALE = 0.005; // pixels per metre
const MAX_SCALE = 20;

export class View {
  constructor() {
    this.east = 0;
    this.north = 0;
    this.scale = 0.1;
    this.width = 1;
    this.height = 1;
  }

  x(east) {
    return this.width / 2 + (east - this.east) * this.scale;
  }

  y(north) {
    return this.height / 2 - (north - this.north) * this.scale;
  }

  place(x, y) {
    return [this.east + (x - this.width / 2) / this.scale, this.north - (y - this.height / 2) / this.scale];
  }

  pan(dx, dy) {
    this.east -= dx / this.scale;
    this.north += dy / this.scale;
  }

  zoom(factor, x = this.width / 2, y = this.height / 2) {
    const [east, north] = this.place(x, y);
    this.scale = Math.min(MAX_SCALE, Math.max(MIN_SCALE, this.scale * factor));
    const [eastNow, northNow] = this.place(x, y);
    this.east += east - eastNow;
    this.north += north - northNow;
  }

  // Shows all points, with a margin in pixels.
  fit(points, margin = 40) {
    if (!points.length) return;
    const easts = points.map((point) => point[0]);
    const norths = points.map((point) => point[1]);
    const [west, east, south, north] = [
      Math.min(...easts),
      Math.max(...easts),
      Math.min(...norths),
      Math.max(...norths),
    ];
    this.east = (west + east) / 2;
    this.north = (south + north) / 2;
    const across = Math.max(1, this.width - 2 * margin) / Math.max(east - west, 100);
    const up = Math.max(1, this.height - 2 * margin) / Math.max(north - south, 100);
    this.scale = Math.min(MAX_SCALE, Math.max(MIN_SCALE, Math.min(across, up)));
  }
}
