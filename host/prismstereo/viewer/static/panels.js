// What is written beside the pictures: the link's and the optics' health, the calibration, notes.

const $ = (id) => document.getElementById(id);

/** A table of names and figures; nothing is ever inserted as markup. */
export function table(list, rows) {
  while (list.children.length > 2 * rows.length) list.lastChild.remove();
  rows.forEach(([name, value, bad], i) => {
    let [term, text] = [list.children[2 * i], list.children[2 * i + 1]];
    if (!term) list.append((term = document.createElement('dt')), (text = document.createElement('dd')));
    if (term.textContent !== name) term.textContent = name;
    if (text.textContent !== value) text.textContent = value;
    text.classList.toggle('bad', Boolean(bad));
  });
}

export function bold(text) {
  const made = document.createElement('b');
  made.textContent = text;
  return made;
}

const number = (value, digits = 0, unit = '') => (value === null || value === undefined ? '–' : `${value.toFixed(digits)}${unit}`);

function size(bytes) {
  if (bytes === null || bytes === undefined) return '–';
  return bytes >= 1e6 ? `${(bytes / 1e6).toFixed(1)} MB` : `${(bytes / 1e3).toFixed(0)} kB`;
}

export function showLink(status, page) {
  const health = status.health ?? {};
  const dropped = (health.dropped ?? 0) + (health.pictures_dropped ?? 0);
  table($('link-figures'), [
    ['From the camera', `${size(status.bytes_per_s)}/s`],
    ['To this page', `${size(page.bytesPerSecond)}/s`],
    ['Frames', `${status.frames}`],
    ['… lost on the way', `${status.lost}`, status.lost > 0],
    ['… with gaps', `${status.partial}`, status.partial > 0],
    ['Dropped by the camera', `${dropped}`, dropped > 0],
    ['Skipped by this page', `${status.page.skipped}`],
    ['Damaged packets', `${status.packets_bad}`, status.packets_bad > 0],
    ['Largest coding error', health.bound_px === null || health.bound_px === undefined ? 'none' : number(health.bound_px, 2, ' px')],
    ['Exposure to here', number(status.latency_ms, 0, ' ms')],
    ['Here to screen', number(status.page.delay_ms, 0, ' ms')],
    ['Round trip', number(status.round_trip_ms, 1, ' ms')],
    ['Clock known to', status.clock_bound_ms === null ? '–' : `± ${number(status.clock_bound_ms, 2, ' ms')}`],
    ['Sessions', `${status.sessions}`],
    ['Temperature', number(health.temperature_c, 1, ' °C')],
    ['Up for', health.uptime_s === undefined ? '–' : time(health.uptime_s)],
    ['Last error', health.last_error || 'none', Boolean(health.last_error)],
  ]);
}

export function time(seconds) {
  const whole = Math.max(0, Math.floor(seconds));
  const [h, m, s] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60];
  return `${h ? `${h}:` : ''}${h ? String(m).padStart(2, '0') : m}:${String(s).padStart(2, '0')}`;
}

const FINDINGS = {
  vertical_px: ['Rows of both views', 'px'],
  vertical_slope_px: ['… over the picture', 'px'],
  seam_px: ['Seam at', 'px'],
  brightness_ratio: ['Brightness, left to right', ''],
  sharpness_ratio: ['Sharpness, left to right', ''],
  covered_left: ['Light that the left view kept', ''],
  covered_right: ['… and the right one', ''],
  dust_left: ['Dark spots, left', ''],
  dust_right: ['Dark spots, right', ''],
};

export function showOptics(report) {
  const findings = report?.findings ?? [];
  $('optics-state').textContent = report ? (report.ok ? 'in order' : 'look here') : 'not looked at yet';
  $('optics-state').dataset.state = report ? (report.ok ? 'good' : 'bad') : 'unknown';
  table(
    $('optics-figures'),
    findings.map((one) => {
      const [name, unit] = FINDINGS[one.name] ?? [one.name, ''];
      const value = one.value === null ? 'cannot be told yet' : `${Number(one.value.toFixed(3))}${unit ? ` ${unit}` : ''}`;
      return [name, value, one.state === 'warn'];
    })
  );
  $('optics-mend').textContent = findings.map((one) => one.mend).filter(Boolean).join('; ');
}

const ADVICE = {
  fine: ['fine', 'good'],
  refine: ['refine', 'warn'],
  recalibrate: ['recalibrate', 'bad'],
  unknown: ['not judged yet', 'unknown'],
};

export function showCalibration(judged, geometry) {
  const [word, state] = ADVICE[judged?.advice] ?? ADVICE.unknown;
  $('calibration-state').textContent = geometry ? word : 'none';
  $('calibration-state').dataset.state = geometry ? state : 'bad';
  const rows = [];
  if (geometry) {
    rows.push(['Rig', geometry.rig], ['Baseline', `${geometry.baseline.toFixed(2)} ${geometry.unit === 'mm' ? 'mm' : 'squares'}`]);
    const far = geometry.far === null ? 'infinity' : `${geometry.far.toFixed(0)} ${geometry.unit}`;
    rows.push(['Range', `${geometry.near.toFixed(0)} ${geometry.unit} to ${far}`]);
    rows.push(['Residual of its board views', geometry.rms_px === null ? 'from the rig file' : `${geometry.rms_px.toFixed(3)} px`]);
  }
  for (const one of judged?.findings ?? []) {
    rows.push([one.name, `${Number(one.value.toFixed(3))} ${one.unit}`, one.advice !== 'fine']);
  }
  table($('calibration-figures'), rows);
  $('calibration-why').textContent = [judged?.why, judged?.by && judged.advice !== 'unknown' ? `judged by ${judged.by}` : '']
    .filter(Boolean)
    .join(' · ');
}

let clearing = 0;

/** Say something, for as long as it takes to read it. */
export function note(text, bad = false) {
  const place = $('note');
  place.textContent = text;
  place.hidden = false;
  place.classList.toggle('bad', bad);
  clearTimeout(clearing);
  clearing = setTimeout(() => (place.hidden = true), Math.max(4000, 60 * text.length));
}
