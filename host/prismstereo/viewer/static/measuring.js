// What lies under the pointer, the points that were picked and their distance, and why pixels are empty.

import { REASONS } from './colours.js';
import { distance, pick, say } from './measure.js';
import { bold, note, table } from './panels.js';

const HINT = 'Point to read depths, click two points to measure.';
const $ = (id) => document.getElementById(id);

export class Measuring {
  /** The views call `hover` and `add`; what was picked is shown in both. */
  constructor() {
    Object.assign(this, { frame: null, picks: [], depth: null, cloud: null, picked: null });
  }

  /** Go on with a newer frame: points stay on their pixels, and go with the scene. */
  setFrame(frame) {
    this.frame = frame;
    this.picks = this.picks.map((one) => pick(frame, one.x, one.y) ?? one);
    this.show();
    if (this.depth.hover) this.hover(...this.depth.hover);
  }

  hover(x, y) {
    const { frame } = this;
    $('hover').textContent = x === null || !frame ? HINT : `column ${x}, row ${y} · ${this.words(x, y, y * frame.width + x)}`;
  }

  words(x, y, index) {
    const { frame } = this;
    if (frame.steps[index] === 0) {
      const reason = this.depth.reasonAt(x, y);
      return `nothing matched${reason ? `: ${REASONS[reason][0]}` : ''}`;
    }
    const disparity = `disparity ${frame.disparity(index).toFixed(2)} px`;
    const one = pick(frame, x, y);
    if (!one) return `${disparity}${frame.metric ? ' · very far' : ''}`;
    return `${say(one.z, frame.head.unit)} ± ${say(one.sigmaZ, frame.head.unit)} · ${disparity}`;
  }

  add(x, y) {
    const one = this.frame ? pick(this.frame, x, y) : null;
    if (!one) {
      note('Nothing is matched there: pick a coloured place.');
      return;
    }
    this.picks = this.picks.length === 2 ? [one] : [...this.picks, one];
    this.show();
  }

  clear() {
    this.picks = [];
    this.show();
  }

  show() {
    const { picks, frame } = this;
    this.depth.picks = this.cloud.picks = picks;
    this.depth.ask();
    this.cloud.ask();
    const unit = frame?.head.unit ?? 'mm';
    $('clear').hidden = picks.length === 0;
    const rows = picks.flatMap((one, i) => [
      [`${'AB'[i]}: depth`, `${say(one.z, unit)} ± ${say(one.sigmaZ, unit)}`],
      [`${'AB'[i]}: X, Y`, `${say(one.point[0], unit)}, ${say(one.point[1], unit)}`],
    ]);
    table($('picked'), rows);
    this.picked = null;
    if (picks.length < 2) {
      $('distance').replaceChildren('–');
      $('distance-about').textContent = picks.length ? 'Now the second point.' : 'Click two points, in the map or in space.';
      return;
    }
    const { length, sigma } = distance(...picks);
    const about = document.createElement('small');
    about.textContent = ` ± ${say(sigma, unit)}`;
    $('distance').replaceChildren(say(length, unit), about);
    $('distance-about').textContent =
      'One standard deviation of matching and aim; what the calibration is off by comes on top.';
    this.picked = { distance: length, sigma };
  }

  /** Why pixels are unmatched, the most frequent reason first. */
  legend() {
    const { reasons, why } = this.depth;
    $('legend').hidden = !why || !reasons;
    if ($('legend').hidden) return;
    const counts = new Array(REASONS.length).fill(0);
    for (const reason of reasons.plane) if (reason < counts.length) counts[reason]++;
    const rows = counts.map((count, reason) => ({ count, reason })).filter((one) => one.reason && one.count);
    rows.sort((a, b) => b.count - a.count);
    $('legend').replaceChildren(...rows.map((one) => line(one, reasons.plane.length)));
  }
}

function line({ count, reason }, all) {
  const row = document.createElement('li');
  const mark = document.createElement('i');
  mark.style.background = REASONS[reason][1];
  row.append(mark, REASONS[reason][0], bold(`${((100 * count) / all).toFixed(1)} %`));
  return row;
}
