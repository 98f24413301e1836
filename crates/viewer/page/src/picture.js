// The B-mode image with depth scale, tracked box, estimated and true tip.

import { OVER } from "./colours.js";

const LEFT = 40;
const TOP = 6;

export class Picture {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    /** The image alone, for the 3-D scene too. */
    this.image = document.createElement("canvas");
    this.imageContext = this.image.getContext("2d");
    this.number = null;
  }

  /** `setting` as in summary.json. */
  begin(setting) {
    this.setting = setting;
    const [left, right] = setting.columns_px;
    Object.assign(this.image, { width: right - left, height: setting.image_px[1] });
    Object.assign(this.canvas, { width: this.image.width + LEFT + TOP, height: this.image.height + 2 * TOP });
    this.data = this.imageContext.createImageData(this.image.width, this.image.height);
    this.data.data.fill(255);
    this.number = null;
  }

  show(pixels, number) {
    const rgba = new Uint32Array(this.data.data.buffer);
    for (let k = 0; k < pixels.length; k += 1) rgba[k] = 0xff000000 | (pixels[k] * 0x010101);
    this.imageContext.putImageData(this.data, 0, 0);
    this.number = number;
  }

  draw(row, { box, truth }) {
    if (!this.setting) return;
    const { context: c, canvas, setting } = this;
    c.fillStyle = "#000";
    c.fillRect(0, 0, canvas.width, canvas.height);
    c.drawImage(this.image, LEFT, TOP);
    this.scale();
    if (!row) return;
    const at = ([u, v]) => [LEFT + u - setting.columns_px[0] + 0.5, TOP + v + 0.5];
    c.lineWidth = 2;
    if (box && row.tip_px) {
      const [x, y] = at(row.tip_px);
      const side = setting.template_px;
      c.strokeStyle = OVER[row.state] ?? OVER.scale;
      c.setLineDash(row.state === "tracking" ? [] : [4, 4]);
      c.strokeRect(x - side / 2, y - side / 2, side, side);
      c.setLineDash([]);
      this.cross(x, y, 4);
    }
    if (truth) {
      c.strokeStyle = OVER.truth;
      // Where the tip is off the plane, its projection is no echo: a ring.
      const [x, y] = at(row.true_tip_px);
      if (row.visible) this.cross(x, y, 9);
      else {
        c.beginPath();
        c.arc(x, y, 8, 0, 2 * Math.PI);
        c.stroke();
      }
    }
  }

  cross(x, y, r) {
    const { context: c } = this;
    c.beginPath();
    c.moveTo(x - r, y);
    c.lineTo(x + r, y);
    c.moveTo(x, y - r);
    c.lineTo(x, y + r);
    c.stroke();
  }

  /** Depth from the transducer's face, in millimetres. */
  scale() {
    const { context: c, setting } = this;
    c.fillStyle = c.strokeStyle = OVER.scale;
    c.lineWidth = 1;
    c.font = "13px system-ui, sans-serif";
    c.textAlign = "right";
    c.textBaseline = "middle";
    const depth = setting.image_px[1] * setting.spacing_mm;
    for (let mm = 0; mm < depth; mm += 5) {
      const y = TOP + mm / setting.spacing_mm + 0.5;
      c.beginPath();
      c.moveTo(LEFT - (mm % 10 ? 5 : 9), y);
      c.lineTo(LEFT - 1, y);
      c.stroke();
      if (mm % 10 === 0) c.fillText(mm === 0 ? "mm" : String(mm), LEFT - 12, Math.max(y, 9));
    }
  }
}
