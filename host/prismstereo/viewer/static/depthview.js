// The disparity map as a picture in colours, with what lies under the pointer.

import { REASONS, words } from './colours.js';

const BLANK = 0xff241d17; // unmatched, in ABGR: a calm dark

export class DepthView {
  /** `hovered(x, y)` with null, null when the pointer leaves; `picked(x, y)` for a click or Enter. */
  constructor(canvas, { hovered, picked }) {
    Object.assign(this, { canvas, hovered, picked, frame: null, reasons: null, why: false, picks: [], map: 'viridis' });
    this.pen = canvas.getContext('2d', { alpha: false });
    this.colours = new Uint32Array(65536);
    this.cursor = null;
    canvas.addEventListener('pointermove', (event) => this.point(event));
    canvas.addEventListener('pointerleave', () => this.leave());
    canvas.addEventListener('click', (event) => this.click(event));
    canvas.addEventListener('keydown', (event) => this.key(event));
    canvas.addEventListener('blur', () => this.leave());
  }

  setFrame(frame, range) {
    Object.assign(this, { frame, range });
    this.ask();
  }

  ask() {
    if (this.asked || !this.frame) return;
    this.asked = true;
    requestAnimationFrame(() => {
      this.asked = false;
      this.draw();
    });
  }

  paintColours() {
    const key = `${this.map} ${this.range[0].toFixed(2)} ${this.range[1].toFixed(2)}`;
    if (key === this.key_) return;
    this.key_ = key;
    const ramp = words(this.map);
    const [low, high] = this.range;
    for (let step = 1; step < 65536; step++) {
      const share = (step / 16 - low) / (high - low);
      this.colours[step] = ramp[Math.max(0, Math.min(255, Math.round(255 * share)))];
    }
    this.colours[0] = BLANK;
  }

  draw() {
    const { canvas, pen, frame } = this;
    if (canvas.width !== frame.width || canvas.height !== frame.height) {
      Object.assign(canvas, { width: frame.width, height: frame.height });
      this.image = new ImageData(frame.width, frame.height);
      this.pixels = new Uint32Array(this.image.data.buffer);
    }
    this.paintColours();
    const { pixels, colours } = this;
    for (let i = 0; i < pixels.length; i++) pixels[i] = colours[frame.steps[i]];
    if (this.why && this.reasons) this.paintReasons();
    pen.putImageData(this.image, 0, 0);
    this.write();
  }

  paintReasons() {
    const { pixels, frame, reasons } = this;
    const colours = REASONS.map(([, hex]) => 0xff000000 | (parseInt(hex.slice(5, 7), 16) << 16) | (parseInt(hex.slice(3, 5), 16) << 8) | parseInt(hex.slice(1, 3), 16));
    for (let y = 0; y < frame.height; y++) {
      for (let x = 0; x < frame.width; x++) {
        const i = y * frame.width + x;
        if (frame.steps[i] === 0) {
          const reason = this.reasonAt(x, y, reasons);
          if (reason) pixels[i] = colours[reason] ?? BLANK;
        }
      }
    }
  }

  reasonAt(x, y, reasons = this.reasons) {
    if (!reasons) return 0;
    const [left, top] = reasons.crop;
    const column = Math.floor((x - left) / reasons.step);
    const row = Math.floor((y - top) / reasons.step);
    const inside = column >= 0 && row >= 0 && column < reasons.width && row < reasons.height;
    return inside ? reasons.plane[row * reasons.width + column] : 0;
  }

  write() {
    const { pen, canvas } = this;
    const size = canvas.width / Math.max(1, this.box().width);
    pen.lineWidth = 2 * size;
    pen.font = `600 ${12 * size}px system-ui, sans-serif`;
    const ring = (x, y, colour, radius) => {
      pen.strokeStyle = colour;
      pen.beginPath();
      pen.arc(x + 0.5, y + 0.5, radius * size, 0, 2 * Math.PI);
      pen.stroke();
    };
    if (this.picks.length === 2) {
      pen.strokeStyle = '#fff';
      pen.beginPath();
      pen.moveTo(this.picks[0].x, this.picks[0].y);
      pen.lineTo(this.picks[1].x, this.picks[1].y);
      pen.stroke();
    }
    this.picks.forEach((one, i) => {
      ring(one.x, one.y, '#000', 7);
      ring(one.x, one.y, '#fff', 5);
      pen.fillStyle = '#fff';
      pen.fillText('AB'[i], one.x + 9 * size, one.y - 6 * size);
    });
    if (this.cursor && document.activeElement === canvas) ring(...this.cursor, '#fff', 9);
  }

  /** Where the picture lies within its element: all of it is shown, borders are left free. */
  box() {
    const { clientWidth: w, clientHeight: h, width, height } = this.canvas;
    const scale = Math.min(w / width, h / height);
    return { left: (w - scale * width) / 2, top: (h - scale * height) / 2, width: scale * width, scale };
  }

  at(event) {
    if (!this.frame) return null;
    const box = this.box();
    const x = Math.floor((event.offsetX - box.left) / box.scale);
    const y = Math.floor((event.offsetY - box.top) / box.scale);
    return x >= 0 && y >= 0 && x < this.frame.width && y < this.frame.height ? [x, y] : null;
  }

  point(event) {
    const at = this.at(event);
    this.hover = at;
    this.hovered(...(at ?? [null, null]));
  }

  leave() {
    this.hover = null;
    this.hovered(null, null);
    this.ask();
  }

  click(event) {
    const at = this.at(event);
    if (at) this.picked(...at);
  }

  key(event) {
    if (!this.frame) return;
    const ways = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    const way = ways[event.key];
    const cursor = this.cursor ?? [this.frame.width >> 1, this.frame.height >> 1];
    if (way) {
      const step = event.shiftKey ? 1 : 8;
      this.cursor = [
        Math.max(0, Math.min(this.frame.width - 1, cursor[0] + step * way[0])),
        Math.max(0, Math.min(this.frame.height - 1, cursor[1] + step * way[1])),
      ];
      this.hover = this.cursor;
      this.hovered(...this.cursor);
    } else if (event.key === 'Enter' || event.key === ' ') this.picked(...cursor);
    else return;
    event.preventDefault();
    this.ask();
  }
}
