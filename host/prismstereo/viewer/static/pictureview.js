// The camera's pictures: the left view, the raw frame with its seam, the rectified pair with lines that both views share.

const LINES = 12;

export class PictureView {
  constructor(canvas) {
    Object.assign(this, { canvas, show: 'left', raw: null, held: {} });
    this.pen = canvas.getContext('2d', { alpha: false });
  }

  /** Take a picture of a kind (left, raw, pair). */
  set(kind, bitmap, head) {
    this.held[kind]?.bitmap.close();
    this.held[kind] = { bitmap, head };
    if (kind === this.show) this.draw();
  }

  choose(kind) {
    this.show = kind;
    this.draw();
  }

  draw() {
    const { canvas, pen } = this;
    const held = this.held[this.show];
    canvas.hidden = !held;
    if (!held) return;
    const { bitmap } = held;
    if (canvas.width !== bitmap.width || canvas.height !== bitmap.height) {
      Object.assign(canvas, { width: bitmap.width, height: bitmap.height });
    }
    pen.drawImage(bitmap, 0, 0);
    const size = Math.max(1, canvas.width / Math.max(1, canvas.clientWidth));
    if (this.show === 'raw' && this.raw) this.seam(size);
    if (this.show === 'pair') this.lines(size);
  }

  seam(size) {
    const { pen, raw } = this;
    pen.lineWidth = 1.5 * size;
    pen.font = `600 ${13 * size}px system-ui, sans-serif`;
    for (const [name, [x, y, w, h], colour] of [['left view', raw.left, '#ffd34d'], ['right view', raw.right, '#6db8ff']]) {
      pen.strokeStyle = colour;
      pen.setLineDash([6 * size, 4 * size]);
      pen.strokeRect(x + size, y + size, w - 2 * size, h - 2 * size);
      pen.setLineDash([]);
      label(pen, name, x + 10 * size, y + 20 * size, colour, size);
    }
  }

  lines(size) {
    const { canvas, pen } = this;
    pen.lineWidth = size;
    for (let i = 1; i < LINES; i++) {
      const y = Math.round((canvas.height * i) / LINES) + 0.5;
      pen.strokeStyle = i % 2 ? '#ffd34d99' : '#6db8ff99';
      pen.beginPath();
      pen.moveTo(0, y);
      pen.lineTo(canvas.width, y);
      pen.stroke();
    }
    pen.font = `600 ${13 * size}px system-ui, sans-serif`;
    label(pen, 'left', 10 * size, 20 * size, '#fff', size);
    label(pen, 'right', canvas.width / 2 + 10 * size, 20 * size, '#fff', size);
  }
}

function label(pen, text, x, y, colour, size) {
  const width = pen.measureText(text).width;
  pen.fillStyle = '#000a';
  pen.fillRect(x - 5 * size, y - 14 * size, width + 10 * size, 20 * size);
  pen.fillStyle = colour;
  pen.fillText(text, x, y);
}
