// Detections, which fade with age. They are many, so they are written into an image and not drawn one by one.

const FADE_MS = 4000;
const MAX_ALPHA = 190;

export class Detections {
  constructor() {
    this.scans = [];
    this.canvas = new OffscreenCanvas(1, 1);
    this.ctx = this.canvas.getContext("2d");
  }

  get isEmpty() {
    return !this.scans.length;
  }

  clear() {
    this.scans = [];
  }

  add(scans) {
    const at = performance.now();
    this.scans.push(...scans.map(({ z }) => ({ at, z })));
  }

  draw(ctx, view, colour) {
    const [width, height] = [Math.ceil(view.width), Math.ceil(view.height)];
    if (this.canvas.width !== width || this.canvas.height !== height) {
      Object.assign(this.canvas, { width, height });
      this.image = this.ctx.createImageData(width, height);
      this.pixels = new Uint32Array(this.image.data.buffer);
    }
    this.pixels.fill(0);
    const tint = parseInt(colour.slice(5, 7) + colour.slice(3, 5) + colour.slice(1, 3), 16); // #rrggbb to bytes b g r
    const now = performance.now();
    this.scans = this.scans.filter((scan) => now - scan.at < FADE_MS);
    for (const { at, z } of this.scans) {
      const alpha = Math.round(MAX_ALPHA * (1 - (now - at) / FADE_MS));
      if (alpha > 0) this.write(z, view, width, height, ((alpha << 24) | tint) >>> 0);
    }
    this.ctx.putImageData(this.image, 0, 0);
    ctx.drawImage(this.canvas, 0, 0);
  }

  write(z, view, width, height, pixel) {
    for (let index = 0; index < z.length; index += 2) {
      const x = Math.round(view.x(z[index]));
      const y = Math.round(view.y(z[index + 1]));
      if (x < 0 || y < 0 || x >= width - 1 || y >= height - 1) continue;
      const first = y * width + x;
      this.pixels[first] =
        this.pixels[first + 1] =
        this.pixels[first + width] =
        this.pixels[first + width + 1] =
          pixel;
    }
  }
}
