// Tools of the map: measure a distance, draw or change a no-fly zone. Escape ends a tool.

import { openDialog } from "./dialogs.js";
import { el, setText } from "./dom.js";
import { metres } from "./format.js";
import { ZoneEdit } from "./zone_edit.js";

export class Measure {
  constructor() {
    this.hint = "Click two points. Esc ends.";
    this.points = [];
    this.pointer = null;
  }

  click(place) {
    this.points = this.points.length === 1 ? [...this.points, place] : [place];
  }

  hover(place) {
    this.pointer = place;
  }

  draw(ctx, view, colour) {
    const points = this.points.length === 1 && this.pointer ? [...this.points, this.pointer] : this.points;
    if (points.length < 2) return;
    const [[e0, n0], [e1, n1]] = points;
    stroke(ctx, view, points, colour("advisory"));
    const bearing = ((Math.atan2(e1 - e0, n1 - n0) * 180) / Math.PI + 360) % 360;
    ctx.fillStyle = colour("text");
    ctx.textAlign = "left";
    ctx.fillText(
      `${metres(Math.hypot(e1 - e0, n1 - n0))}  ${bearing.toFixed(0)}°`,
      view.x(e1) + 12,
      view.y(n1) - 8,
    );
  }
}

class ZoneCircle {
  constructor(done) {
    this.hint = "Press at the centre and drag to the edge. Esc ends.";
    this.drag = true;
    this.done = done;
    this.centre = this.radius = null;
  }

  down(place) {
    this.centre = place;
    this.radius = 0;
  }

  move(place) {
    this.radius = Math.hypot(place[0] - this.centre[0], place[1] - this.centre[1]);
  }

  up() {
    if (this.radius > 1) this.done({ circle: [...this.centre, this.radius].map(Math.round) });
  }

  draw(ctx, view, colour) {
    if (!this.centre) return;
    ctx.strokeStyle = colour("warning");
    ctx.lineWidth = 2;
    ctx.beginPath();
    ctx.arc(view.x(this.centre[0]), view.y(this.centre[1]), this.radius * view.scale, 0, 2 * Math.PI);
    ctx.stroke();
  }
}

class ZonePolygon {
  constructor(done) {
    this.hint = "Click the corners; click the first one again to close. Esc ends.";
    this.done = done;
    this.points = [];
    this.pointer = null;
    this.view = null;
  }

  click(place) {
    const [first] = this.points;
    const isClosing =
      this.points.length > 2 && Math.hypot(place[0] - first[0], place[1] - first[1]) * this.view.scale < 14;
    if (isClosing) this.done({ polygon: this.points.map((point) => point.map(Math.round)) });
    else this.points.push(place);
  }

  hover(place) {
    this.pointer = place;
  }

  draw(ctx, view, colour) {
    this.view = view;
    if (this.points.length)
      stroke(ctx, view, this.pointer ? [...this.points, this.pointer] : this.points, colour("warning"));
  }
}

function stroke(ctx, view, points, tint) {
  ctx.strokeStyle = tint;
  ctx.lineWidth = 2;
  ctx.beginPath();
  points.forEach(([east, north], index) => ctx[index ? "lineTo" : "moveTo"](view.x(east), view.y(north)));
  ctx.stroke();
}

// The dialog of a no-fly zone: by numbers, or drawn on the map.
export class Zones {
  constructor(map, feed, orders) {
    this.map = map;
    this.feed = feed;
    this.orders = orders;
  }

  freeName() {
    const names = new Set((this.feed.data.zones ?? []).map((zone) => zone.name));
    let number = 1;
    while (names.has(`zone-${number}`)) number++;
    return `zone-${number}`;
  }

  open(drawn = null) {
    const [east, north] = drawn?.circle ?? [this.map.view.east, this.map.view.north].map(Math.round);
    const field = (label, value) => {
      const input = el("input", { value, "aria-label": label });
      return [el("label", {}, label), input];
    };
    const name = field("Name", this.freeName());
    const numbers = [
      field("Centre east, m", east),
      field("Centre north, m", north),
      field("Radius, m", drawn?.circle?.[2] ?? 100),
    ];
    const problem = el("div", { class: "problem", role: "alert" });
    const fields = el("div", { class: "fields" }, ...name, ...(drawn?.polygon ? [] : numbers.flat()));
    const text = drawn?.polygon
      ? `A polygon with ${drawn.polygon.length} corners.`
      : "Routes around the area are planned at once.";
    const close = () => {
      const circle = numbers.map(([, input]) => Number(input.value));
      const shape = drawn?.polygon ? { polygon: drawn.polygon } : { circle };
      if (!/^[A-Za-z0-9_.-]{1,64}$/.test(name[1].value))
        setText(problem, "Name: letters, digits, _ . - only.");
      else if (!drawn?.polygon && !(circle.every(Number.isFinite) && circle[2] > 0))
        setText(problem, "Expected numbers, and a radius above 0.");
      else {
        this.orders.give("no-fly-zone", { no_fly_zone: { name: name[1].value, ...shape } });
        dialog.close();
      }
    };
    const draw = (Tool) => () => {
      dialog.close();
      this.map.use(
        new Tool((shape) => {
          this.map.use(null);
          this.open(shape);
        }),
      );
    };
    const dialog = openDialog(
      "No-fly zone",
      [el("p", {}, text), fields, problem],
      [
        el("button", { onclick: draw(ZoneCircle) }, "Draw a circle"),
        el("button", { onclick: draw(ZonePolygon) }, "Draw a polygon"),
        el("button", { onclick: () => dialog.close() }, "Cancel"),
        el("button", { class: "danger", onclick: close }, "Close this area"),
      ],
    );
    name[1].focus();
  }

  // Drags the handles of a closed zone; the same name with another shape replaces it.
  edit(name) {
    const zone = (this.feed.data.zones ?? []).find((one) => one.name === name);
    if (!zone) return;
    const [east, north] = zone.disc ?? zone.polygon[0];
    this.map.show([east, north]);
    const send = (shape) => {
      this.orders.give("no-fly-zone", { no_fly_zone: { name, ...shape } });
      this.map.use(null);
    };
    this.map.use(new ZoneEdit(zone, send, () => this.map.use(null)));
  }

  reopen(name) {
    this.orders.give("no-fly-zone", { no_fly_zone: { name } });
  }
}
