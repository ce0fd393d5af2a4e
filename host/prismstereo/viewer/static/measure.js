// A point that somebody picked, how sure its depth is, and the distance of two of them.

const REACH = 3; // pixels around a pick that a plane is laid through
const FEWEST = 6;
const LEAST_PX = 1 / 16; // no match is trusted better than a step of the wire
const AIM_PX = 0.29; // half a pixel of aim, as a standard deviation

/** Solve a symmetric 3x3 system; null where it has no single answer. */
function solve(A, b) {
  const m = A.map((row, i) => [...row, b[i]]);
  for (let i = 0; i < 3; i++) {
    let best = i;
    for (let j = i + 1; j < 3; j++) if (Math.abs(m[j][i]) > Math.abs(m[best][i])) best = j;
    [m[i], m[best]] = [m[best], m[i]];
    if (Math.abs(m[i][i]) < 1e-9) return null;
    for (let j = 0; j < 3; j++) {
      if (j === i) continue;
      const k = m[j][i] / m[i][i];
      for (let c = i; c < 4; c++) m[j][c] -= k * m[i][c];
    }
  }
  return m.map((row, i) => row[3] / row[i]);
}

function around(frame, x, y) {
  const found = [];
  const middle = frame.disparity(y * frame.width + x);
  for (let dy = -REACH; dy <= REACH; dy++) {
    for (let dx = -REACH; dx <= REACH; dx++) {
      if (x + dx < 0 || x + dx >= frame.width || y + dy < 0 || y + dy >= frame.height) continue;
      const d = frame.disparity((y + dy) * frame.width + x + dx);
      if (Math.abs(d - middle) < 1.5) found.push([dx, dy, d]);
    }
  }
  return found;
}

/** The point under a pixel: a plane through the matches around it, and their scatter. Null where nothing is matched. */
export function pick(frame, x, y) {
  if (!frame.metric || !Number.isFinite(frame.depthAt(y * frame.width + x))) return null;
  const found = around(frame, x, y);
  let d = frame.disparity(y * frame.width + x);
  let scatter = LEAST_PX;
  if (found.length >= FEWEST) {
    const A = [[0, 0, 0], [0, 0, 0], [0, 0, 0]];
    const b = [0, 0, 0];
    for (const [dx, dy, value] of found) {
      const terms = [1, dx, dy];
      for (let i = 0; i < 3; i++) {
        b[i] += terms[i] * value;
        for (let j = 0; j < 3; j++) A[i][j] += terms[i] * terms[j];
      }
    }
    const plane = solve(A, b);
    if (plane) {
      const rest = found.reduce((sum, [dx, dy, value]) => sum + (value - plane[0] - plane[1] * dx - plane[2] * dy) ** 2, 0);
      scatter = Math.max(LEAST_PX, Math.sqrt(rest / (found.length - 3)));
      d = plane[0];
    }
  }
  const z = frame.depth(d);
  const ray = frame.ray(x, y);
  const sigmaZ = ((z * z) / frame.head.scale_px) * scatter;
  return { x, y, z, ray, point: ray.map((part) => part * z), sigmaZ, sigmaAcross: (AIM_PX * z) / frame.head.projection.focal_px };
}

/** The distance of two picks and one standard deviation of it: matching and aim, without the calibration's own error. */
export function distance(a, b) {
  const apart = a.point.map((part, i) => part - b.point[i]);
  const length = Math.hypot(...apart);
  if (length === 0) return { length, sigma: Math.hypot(a.sigmaAcross, b.sigmaAcross) };
  const along = apart.map((part) => part / length);
  const variance = [a, b].reduce((sum, one) => {
    const inDepth = one.ray.reduce((total, part, i) => total + part * along[i], 0) * one.sigmaZ;
    return sum + inDepth ** 2 + one.sigmaAcross ** 2;
  }, 0);
  return { length, sigma: Math.sqrt(variance) };
}

/** A length with its unit, with no more digits than are worth saying. */
export function say(value, unit = 'mm', digits = 1) {
  if (!Number.isFinite(value)) return value === Infinity ? 'very far' : '–';
  if (unit !== 'mm') return `${value.toFixed(2)} squares`;
  if (Math.abs(value) >= 10000) return `${(value / 1000).toFixed(2)} m`;
  return `${value.toFixed(digits)} mm`;
}
