// Map tiles of the service's MBTiles file, placed by the corners of each tile in the local frame.

const MAJOR_M = 6378137;
const FLATTENING = 1 / 298.257223563;
const TILE_PX = 256;
const MAX_TILES = 80; // of one picture
const MAX_KEPT = 300;
const METRES_PER_DEGREE = 111320;

const radians = (degrees) => (degrees * Math.PI) / 180;

function ecef(lat, lon, alt) {
  const e2 = FLATTENING * (2 - FLATTENING);
  const normal = MAJOR_M / Math.sqrt(1 - e2 * Math.sin(lat) ** 2);
  const ring = (normal + alt) * Math.cos(lat);
  return [ring * Math.cos(lon), ring * Math.sin(lon), (normal * (1 - e2) + alt) * Math.sin(lat)];
}

// East and north of a place, as gcs.geo.LocalFrame.to_local.
export function toLocal([lat0, lon0, alt0], lat, lon) {
  const [a, b] = [radians(lat0), radians(lon0)];
  const origin = ecef(a, b, alt0);
  const [u, v, w] = ecef(radians(lat), radians(lon), alt0).map((value, axis) => value - origin[axis]);
  const outward = Math.cos(b) * u + Math.sin(b) * v;
  return [-Math.sin(b) * u + Math.cos(b) * v, -Math.sin(a) * outward + Math.cos(a) * w];
}

const columnOf = (lon, zoom) => ((lon + 180) / 360) * 2 ** zoom;
const rowOf = (lat, zoom) => ((1 - Math.asinh(Math.tan(radians(lat))) / Math.PI) / 2) * 2 ** zoom;
const lonOf = (column, zoom) => (column / 2 ** zoom) * 360 - 180;
const latOf = (row, zoom) => (Math.atan(Math.sinh(Math.PI * (1 - (2 * row) / 2 ** zoom))) * 180) / Math.PI;

export class Tiles {
  constructor(redraw) {
    this.redraw = redraw;
    this.images = new Map();
  }

  draw(ctx, view, { tiles, origin_deg: [lat0, lon0], origin_alt_m: alt0 }) {
    const origin = [lat0, lon0, alt0];
    const perLon = METRES_PER_DEGREE * Math.cos(radians(lat0));
    const place = (x, y) => {
      const [east, north] = view.place(x, y);
      return [lat0 + north / METRES_PER_DEGREE, lon0 + east / perLon];
    };
    const [north, west] = place(0, 0);
    const [south, east] = place(view.width, view.height);
    if (north > 85 || south < -85) return;
    let zoom = Math.round(Math.log2((360 * perLon * view.scale) / TILE_PX));
    zoom = Math.min(tiles.max_zoom, Math.max(tiles.min_zoom, zoom));
    const columns = [Math.floor(columnOf(west, zoom)), Math.floor(columnOf(east, zoom))];
    const rows = [Math.floor(rowOf(north, zoom)), Math.floor(rowOf(south, zoom))];
    if ((columns[1] - columns[0] + 1) * (rows[1] - rows[0] + 1) > MAX_TILES) return;
    ctx.imageSmoothingEnabled = true;
    for (let row = rows[0]; row <= rows[1]; row++) {
      for (let column = columns[0]; column <= columns[1]; column++)
        this.drawTile(ctx, view, origin, zoom, column, row);
    }
  }

  drawTile(ctx, view, origin, zoom, column, row) {
    const image = this.image(`${zoom}/${column}/${row}`);
    if (!image.complete || !image.naturalWidth) return;
    const [west, north] = toLocal(origin, latOf(row, zoom), lonOf(column, zoom));
    const [east, south] = toLocal(origin, latOf(row + 1, zoom), lonOf(column + 1, zoom));
    const [x, y] = [Math.floor(view.x(west)), Math.floor(view.y(north))];
    ctx.drawImage(image, x, y, Math.ceil(view.x(east)) - x, Math.ceil(view.y(south)) - y);
  }

  image(name) {
    let image = this.images.get(name);
    if (!image) {
      image = new Image();
      image.onload = this.redraw;
      image.src = `tiles/${name}`;
      this.images.set(name, image);
      if (this.images.size > MAX_KEPT) this.images.delete(this.images.keys().next().value);
    }
    return image;
  }
}
