// Tool of the map: change the shape of a no-fly zone by its handles. Nothing is sent before "Send".

const HANDLE_PX = 6;
const HIT_PX = 16;
const MIN_RADIUS_M = 5;

export class ZoneEdit {
  // `done` gets the new shape, as an order has it; `cancel` ends the tool.
  constructor(zone, done, cancel) {
    this.hint = `Drag the handles of ${zone.name}.`;
    this.drag = true;
    this.name = zone.name;
    this.disc = zone.disc ? [...zone.disc] : null;
    this.corners = zone.disc ? [] : zone.polygon.map((corner) => [...corner]);
    this.grabbed = null;
    this.view = null;
    this.actions = [
      ["Send", () => done(this.shape())],
      ["Cancel", cancel],
    ];
  }

  shape() {
    if (this.disc) return { circle: this.disc.map(Math.round) };
    return { polygon: this.corners.map((corner) => corner.map(Math.round)) };
  }

  // The first handle moves the whole zone; that of a circle's edge sets its radius.
  handles() {
    if (this.disc) {
      const [east, north, radius] = this.disc;
      return [
        [east, north],
        [east + radius, north],
      ];
    }
    const middle = [0, 1].map(
      (axis) => this.corners.reduce((sum, corner) => sum + corner[axis], 0) / this.corners.length,
    );
    return [middle, ...this.corners];
  }

  // Returns false if no handle is near: then the map is dragged.
  down(place) {
    const distances = this.handles().map(
      (handle) => Math.hypot(handle[0] - place[0], handle[1] - place[1]) * this.view.scale,
    );
    const nearest = Math.min(...distances);
    this.grabbed = nearest < HIT_PX ? distances.indexOf(nearest) : null;
    return this.grabbed !== null;
  }

  move(place) {
    if (this.grabbed === 0) this.shift(place);
    else if (this.disc)
      this.disc[2] = Math.max(MIN_RADIUS_M, Math.hypot(place[0] - this.disc[0], place[1] - this.disc[1]));
    else this.corners[this.grabbed - 1] = place;
  }

  shift(place) {
    const [middle] = this.handles();
    const by = [place[0] - middle[0], place[1] - middle[1]];
    for (const point of this.disc ? [this.disc] : this.corners) {
      point[0] += by[0];
      point[1] += by[1];
    }
  }

  up() {
    this.grabbed = null;
  }

  draw(ctx, view, colour) {
    this.view = view;
    ctx.strokeStyle = ctx.fillStyle = colour("advisory");
    ctx.lineWidth = 2;
    ctx.beginPath();
    if (this.disc)
      ctx.arc(view.x(this.disc[0]), view.y(this.disc[1]), this.disc[2] * view.scale, 0, 2 * Math.PI);
    else
      this.corners.forEach(([east, north], index) =>
        ctx[index ? "lineTo" : "moveTo"](view.x(east), view.y(north)),
      );
    ctx.closePath();
    ctx.stroke();
    for (const [east, north] of this.handles()) {
      ctx.fillRect(view.x(east) - HANDLE_PX, view.y(north) - HANDLE_PX, 2 * HANDLE_PX, 2 * HANDLE_PX);
    }
  }
}
