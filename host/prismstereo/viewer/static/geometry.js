// From disparity to millimetres: depth = scale / (disparity + offset), with what the glass before the lens adds.
// Camera frame: x right, y down, z forward; pixel (0, 0) is the centre of the top-left pixel.

/** What glass does at every pixel, (linear, square) pairs: the polynomial of the calibration, evaluated once. */
export function glassMaps(glass, width, height) {
  const maps = new Float32Array(2 * width * height);
  const powers = [];
  for (let i = 0; i < 6; i++) for (let j = 0; j < 6 - i; j++) powers.push([i, j, 0]);
  for (let i = 0; i < 3; i++) for (let j = 0; j < 3 - i; j++) powers.push([i, j, 1]);
  const x = new Float64Array(6);
  for (let row = 0; row < height; row++) {
    const y = (2 * row) / (height - 1) - 1;
    const ofRow = [new Float64Array(6), new Float64Array(6)]; // the polynomials in x that are left at this row
    powers.forEach(([i, j, which], at) => (ofRow[which][i] += glass.factors[at] * y ** j));
    for (let column = 0; column < width; column++) {
      const u = (2 * column) / (width - 1) - 1;
      x[0] = 1;
      for (let i = 1; i < 6; i++) x[i] = x[i - 1] * u;
      let linear = 0;
      let square = 0;
      for (let i = 0; i < 6; i++) linear += ofRow[0][i] * x[i];
      for (let i = 0; i < 3; i++) square += ofRow[1][i] * x[i];
      const at = 2 * (row * width + column);
      maps[at] = linear;
      maps[at + 1] = square;
    }
  }
  return maps;
}

/** A frame: its disparities, and how they become points. */
export class Frame {
  constructor(head, steps, glass) {
    Object.assign(this, { head, steps, glass, width: head.width, height: head.height });
    this.metric = head.scale_px > 0 && head.projection !== null;
  }

  /** Disparity in pixels, glass considered; NaN where unmatched. */
  disparity(index) {
    const step = this.steps[index];
    return step === 0 ? NaN : this.freed(step / 16, index);
  }

  freed(disparity, index) {
    if (!this.glass) return disparity;
    const e = (disparity - this.glass.middle_px) / this.glass.half_px;
    return disparity + e * (this.glass.maps[2 * index] + e * this.glass.maps[2 * index + 1]);
  }

  /** Depth of a disparity that is already free of glass. */
  depth(disparity) {
    const total = disparity + this.head.offset_px;
    return total > 0 ? this.head.scale_px / total : Infinity;
  }

  depthAt(index) {
    return this.depth(this.disparity(index));
  }

  ray(x, y) {
    const { focal_px: f, cx_px: cx, cy_px: cy } = this.head.projection;
    return [(x - cx) / f, (y - cy) / f, 1];
  }

  /** The disparities that the middle 98 of 100 matches lie between; null where nothing is matched. */
  span() {
    const counts = new Uint32Array(65536);
    let known = 0;
    for (let i = 0; i < this.steps.length; i += 3) {
      const step = this.steps[i];
      if (step) {
        counts[step]++;
        known++;
      }
    }
    if (known < 50) return null;
    const at = (share) => {
      let seen = 0;
      for (let step = 1; step < 65536; step++) if ((seen += counts[step]) >= share * known) return step / 16;
      return 4096;
    };
    return [at(0.01), at(0.99)];
  }

  density() {
    let known = 0;
    for (let i = 0; i < this.steps.length; i++) known += this.steps[i] !== 0;
    return known;
  }
}
