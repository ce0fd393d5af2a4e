// The scale beside the map, and how many pixels lie at which depth.

import { table } from './colours.js';
import { say } from './measure.js';

const BINS = 72;
const TICKS = 5;

function prepared(canvas) {
  const ratio = Math.min(devicePixelRatio || 1, 2);
  const [w, h] = [canvas.clientWidth, canvas.clientHeight];
  canvas.width = Math.round(w * ratio);
  canvas.height = Math.round(h * ratio);
  const pen = canvas.getContext('2d');
  pen.scale(ratio, ratio);
  return [pen, w, h, getComputedStyle(canvas)];
}

/** A bar of colours with depths beside it, near at the top. */
export function drawScale(canvas, frame, range, map) {
  const [pen, w, h, style] = prepared(canvas);
  if (!w || !h) return;
  const bytes = table(map);
  const [top, tall] = [8, h - 16];
  for (let y = 0; y < tall; y++) {
    const at = 4 * Math.round(255 * (1 - y / tall));
    pen.fillStyle = `rgb(${bytes[at]} ${bytes[at + 1]} ${bytes[at + 2]})`;
    pen.fillRect(0, top + y, 10, 1.5);
  }
  pen.fillStyle = style.color;
  pen.font = '11px system-ui, sans-serif';
  pen.textBaseline = 'middle';
  for (let i = 0; i < TICKS; i++) {
    const share = i / (TICKS - 1);
    const disparity = range[1] + share * (range[0] - range[1]);
    const text = frame.metric ? short(frame.depth(disparity), frame.head.unit) : `${disparity.toFixed(0)} px`;
    pen.fillText(text, 16, top + share * tall);
  }
}

function short(depth, unit) {
  if (!Number.isFinite(depth)) return '∞';
  return unit === 'mm' && depth < 10000 ? `${depth.toFixed(0)}` : say(depth, unit);
}

/** Bars over depth from near to far, in the colours of the map. */
export function drawHistogram(canvas, frame, range, map) {
  const [pen, w, h, style] = prepared(canvas);
  if (!w || !h) return;
  const [low, high] = range;
  const counts = new Float64Array(BINS);
  for (let i = 0; i < frame.steps.length; i += 2) {
    const step = frame.steps[i];
    if (step === 0) continue;
    const bin = Math.floor(((high - step / 16) / (high - low)) * BINS);
    if (bin >= 0 && bin < BINS) counts[bin]++;
  }
  const most = Math.max(...counts, 1);
  const bytes = table(map);
  const tall = h - 16;
  for (let bin = 0; bin < BINS; bin++) {
    const at = 4 * Math.round(255 * (1 - bin / (BINS - 1)));
    pen.fillStyle = `rgb(${bytes[at]} ${bytes[at + 1]} ${bytes[at + 2]})`;
    const bar = tall * Math.sqrt(counts[bin] / most);
    pen.fillRect((bin / BINS) * w, tall - bar, w / BINS - 1, bar);
  }
  pen.fillStyle = style.getPropertyValue('--line');
  pen.fillRect(0, tall, w, 1);
  pen.fillStyle = style.color;
  pen.font = '11px system-ui, sans-serif';
  pen.textBaseline = 'bottom';
  const name = (disparity) => (frame.metric ? short(frame.depth(disparity), frame.head.unit) : `${disparity.toFixed(0)} px`);
  pen.textAlign = 'left';
  pen.fillText(name(high), 0, h);
  pen.textAlign = 'center';
  pen.fillText(name((low + high) / 2), w / 2, h);
  pen.textAlign = 'right';
  pen.fillText(name(low), w, h);
}
