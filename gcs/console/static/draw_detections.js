// Drawing of detections, which fade with age: into an image and not one by one, since they are many.

/**
 * @import { Context } from "./canvas.js"
 * @import { View } from "./map_view.js"
 */

const FADE_MS = 4000;
const MAX_ALPHA = 190;

export class Detections {
  constructor() {
    /** @type {{ at: number, z: number[] }[]} */
    this.scans = [];
    this.canvas = new OffscreenCanvas(1, 1);
    this.image = new ImageData(1, 1);
    this.pixels = new Uint32Array(this.image.data.buffer);
  }

  get isEmpty() {
    return !this.scans.length;
  }

  clear() {
    this.scans = [];
  }

  /** @param {number[][]} scans east and north of the detections of each in turns */
  add(scans) {
    const at = performance.now();
    this.scans.push(...scans.map((z) => ({ at, z })));
  }

  /**
   * @param {Context} ctx
   * @param {View} view
   * @param {string} colour #rrggbb
   */
  draw(ctx, view, colour) {
    this.resize(Math.ceil(view.width), Math.ceil(view.height));
    this.pixels.fill(0);
    const tint = parseInt(colour.slice(5, 7) + colour.slice(3, 5) + colour.slice(1, 3), 16); // bytes b g r
    const now = performance.now();
    this.scans = this.scans.filter((scan) => now - scan.at < FADE_MS);
    for (const { at, z } of this.scans) {
      const alpha = Math.round(MAX_ALPHA * (1 - (now - at) / FADE_MS));
      if (alpha > 0) this.write(z, view, ((alpha << 24) | tint) >>> 0);
    }
    this.canvas.getContext("2d")?.putImageData(this.image, 0, 0);
    ctx.drawImage(this.canvas, 0, 0);
  }

  /**
   * @param {number} width
   * @param {number} height
   */
  resize(width, height) {
    if (this.canvas.width === width && this.canvas.height === height) return;
    this.canvas.width = width;
    this.canvas.height = height;
    this.image = new ImageData(width, height);
    this.pixels = new Uint32Array(this.image.data.buffer);
  }

  /**
   * @param {number[]} z
   * @param {View} view
   * @param {number} pixel
   */
  write(z, view, pixel) {
    const { width, height } = this.canvas;
    for (let index = 0; index < z.length; index += 2) {
      const x = Math.round(view.x(z[index]));
      const y = Math.round(view.y(z[index + 1]));
      if (x < 0 || y < 0 || x >= width - 1 || y >= height - 1) continue;
      const first = y * width + x;
      this.pixels[first] = pixel;
      this.pixels[first + 1] = pixel;
      this.pixels[first + width] = pixel;
      this.pixels[first + width + 1] = pixel;
    }
  }
}
