// The page: what arrives is shown, what is asked for is sent. `window.stats` says what was received and drawn.

import { action, busy } from './actions.js';
import { Cloud } from './cloud.js';
import { MAPS } from './colours.js';
import { DepthView } from './depthview.js';
import { Frame, glassMaps } from './geometry.js';
import { enter, get, Link, post } from './link.js';
import { Measuring } from './measuring.js';
import { bold, note, showCalibration, showLink, showOptics, time } from './panels.js';
import { PictureView } from './pictureview.js';
import { Records } from './records.js';
import { drawHistogram, drawScale } from './scales.js';
import { Settings } from './settings.js';
import { KIND, picture, plane, steps } from './unpack.js';

const CALM = 0.25; // share by which the colours follow the scene, each frame
const $ = (id) => document.getElementById(id);
const held = { frame: null, geometry: null, range: null, glass: null };
const traffic = { bytes: 0, at: performance.now(), before: 0 };
window.stats = { frames: 0, points: 0, drawn: 0, bytes: 0, pictures: 0, reasons: 0 };

Object.defineProperty(window.stats, 'picked', { enumerable: true, get: () => measuring.picked });

const pictures = new PictureView($('picture'));
const measuring = new Measuring();
const depth = new DepthView($('depth'), {
  hovered: (x, y) => measuring.hover(x, y),
  picked: (x, y) => measuring.add(x, y),
});
const cloud = new Cloud($('cloud'), $('over'), (x, y) => measuring.add(x, y));
Object.assign(measuring, { depth, cloud });
$('no-gl').hidden = cloud.works;
const settings = new Settings($('settings'), { change: (name, value) => post('set', { name, value }), note });
const records = new Records({ list: $('records'), live: $('go-live'), note, changed: () => refresh() });

// ---- what arrives

async function hear(kind, head, body, bytes) {
  traffic.bytes += bytes;
  window.stats.bytes += bytes;
  if (kind === KIND.disparity) {
    const map = await steps(head, body);
    showFrame(new Frame(head, map, glassOf(head)));
  } else if (kind === KIND.reasons) {
    depth.reasons = { ...head, plane: await plane(body) };
    window.stats.reasons++;
    if (depth.why) {
      depth.ask();
      measuring.legend();
    }
  } else {
    const names = { [KIND.left]: 'left', [KIND.raw]: 'raw', [KIND.pair]: 'pair' };
    const bitmap = await picture(body);
    if (kind === KIND.left) cloud.setPicture(bitmap);
    pictures.set(names[kind], bitmap, head);
    window.stats.pictures++;
  }
}

/** What glass does to this frame; the maps are made once for a calibration. */
function glassOf(head) {
  const glass = held.geometry?.glass;
  if (!glass || !head.projection?.glass) return null;
  if (!held.glass || held.glass.of !== glass) {
    held.glass = { of: glass, ...glass, maps: glassMaps(glass, head.width, head.height) };
  }
  return held.glass;
}

function showFrame(frame) {
  held.frame = frame;
  held.range = rangeOf(frame) ?? [0, frame.head.labels];
  window.stats.frames++;
  window.stats.points = frame.density();
  depth.setFrame(frame, held.range);
  cloud.setFrame(frame, held.range);
  measuring.setFrame(frame);
  soon();
}

/** The disparities at the far and the near end of the colours. */
function rangeOf(frame) {
  if (!$('auto-range').checked && frame.metric) {
    const ends = [Number($('far').value), Number($('near').value)].map((z) => frame.head.scale_px / z - frame.head.offset_px);
    if (ends.every(Number.isFinite) && ends[0] < ends[1]) return ends;
  }
  const span = frame.span();
  if (!span) return held.range;
  const wide = [span[0], Math.max(span[1], span[0] + 1)];
  const before = held.range;
  if (!before || Math.abs(before[1] - wide[1]) > 24) return wide;
  return before.map((end, i) => end + CALM * (wide[i] - end));
}

let drawing = false;

/** Scale and histogram: a few times a second is enough. */
function soon() {
  if (drawing) return;
  drawing = true;
  setTimeout(() => {
    drawing = false;
    window.stats.drawn = cloud.drawn;
    if (!held.frame) return;
    drawScale($('scale'), held.frame, held.range, depth.map);
    drawHistogram($('histogram'), held.frame, held.range, depth.map);
    $('histogram-unit').textContent = held.frame.metric ? held.frame.head.unit : 'px of disparity';
    if ($('auto-range').checked && held.frame.metric) {
      $('near').value = held.frame.depth(held.range[1]).toFixed(0);
      const far = held.frame.depth(held.range[0]);
      $('far').value = Number.isFinite(far) ? far.toFixed(0) : '';
    }
    if (depth.why) measuring.legend();
  }, 200);
}

const words = {
  note: (text) => note(text),
  geometry: (geometry) => {
    held.geometry = geometry;
    held.glass = null;
    pictures.raw = geometry?.raw ?? null;
    showCalibration(held.judged, geometry);
  },
  status: showStatus,
};

function showStatus(status) {
  const now = performance.now();
  const page = { bytesPerSecond: (1000 * (traffic.bytes - traffic.before)) / (now - traffic.at) };
  Object.assign(traffic, { at: now, before: traffic.bytes });
  window.stats.status = status;
  const words = { connected: status.live ? 'live' : 'replaying', silent: 'silent', searching: 'searching', ended: 'ended' };
  const state = { connected: 'good', silent: 'warn', searching: 'warn', ended: 'bad' }[status.state];
  showState(state, `${status.playback?.name ?? status.target} · ${words[status.state] ?? status.state}`);
  $('headline').replaceChildren(bold(status.frames_per_s.toFixed(1)), ' frames/s  ', bold(status.density === null ? '–' : `${(100 * status.density).toFixed(0)} %`), ' matched');
  showLink(status, page);
  showOptics(status.optics);
  held.judged = status.calibration;
  showCalibration(status.calibration, held.geometry);
  showTape(status.tape);
  records.status(status);
  for (const id of ['still', 'background', 'check', 'look']) if (!busy.has(id)) $(id).disabled = !status.able;
  $('record').disabled = !status.live;
}

function showState(state, text) {
  $('dot').dataset.state = state;
  $('state-text').textContent = text;
  document.title = `${text} – prismstereo`;
}

function showTape(tape) {
  $('record').setAttribute('aria-pressed', String(Boolean(tape)));
  $('record-text').textContent = tape ? `Stop ${time(tape.seconds)}` : 'Record';
  if (tape?.problem) note(tape.problem, true);
}

// ---- asking

async function shoot(name) {
  const made = await post(name);
  window.stats.still = made;
  note(`${name === 'still' ? 'Still' : 'Background'} of ${made.width} × ${made.height} pixels kept in ${made.session}.`);
  await records.refresh();
}

action('still', () => shoot('still'), 'Taking …');
action('background', () => shoot('background'), 'Taking …');
action('look', async () => showOptics(await post('optics')), 'Looking …');
action('check', async () => showCalibration(await post('check'), held.geometry), 'Checking …');
action('go-live', async () => {
  await post('live');
  await refresh();
});
$('record').addEventListener('click', async () => {
  const on = $('record').getAttribute('aria-pressed') !== 'true';
  try {
    const { tape, ended } = await post('record', { on, raw: $('record-raw').checked });
    showTape(tape);
    if (ended) note(ended.problem ?? `Recorded ${time(ended.seconds)} as ${ended.name}.`, Boolean(ended.problem));
    await records.refresh();
  } catch (error) {
    note(error.message, true);
  }
});

function wanted() {
  const shown = new Set(['left', document.querySelector('input[name=picture]:checked').value]);
  if ($('why').checked) shown.add('why');
  return [...shown];
}

for (const input of document.querySelectorAll('input[name=picture]')) {
  input.addEventListener('change', () => {
    pictures.choose(input.value);
    link.show(wanted());
  });
}
$('why').addEventListener('change', () => {
  depth.why = $('why').checked;
  link.show(wanted());
  measuring.legend();
  depth.ask();
});
for (const name of MAPS) $('map').append(new Option(name, name));
$('map').addEventListener('change', () => {
  depth.map = $('map').value;
  cloud.setMap(depth.map);
  depth.ask();
  soon();
});
for (const input of document.querySelectorAll('input[name=shape]')) {
  input.addEventListener('change', () => {
    cloud.mesh = input.value === 'mesh';
    cloud.ask();
  });
}
for (const input of document.querySelectorAll('input[name=paint]')) {
  input.addEventListener('change', () => {
    cloud.painted = input.value === 'picture';
    cloud.ask();
  });
}
$('stride').addEventListener('change', () => {
  cloud.stride = Number($('stride').value);
  cloud.ask();
});
$('reset').addEventListener('click', () => cloud.orbit.reset());
$('clear').addEventListener('click', () => measuring.clear());
$('auto-range').addEventListener('change', () => {
  for (const id of ['near', 'far']) $(id).disabled = $('auto-range').checked;
});
for (const id of ['near', 'far']) $(id).addEventListener('change', () => held.frame && showFrame(held.frame));
action('pause', () => post('pause', { on: $('pause').getAttribute('aria-pressed') !== 'true' }));
for (const button of document.querySelectorAll('#tabs button')) {
  button.addEventListener('click', () => {
    document.body.dataset.tab = button.dataset.tab;
    for (const other of document.querySelectorAll('#tabs button')) other.removeAttribute('aria-current');
    button.setAttribute('aria-current', 'true');
    cloud.ask();
    depth.ask();
    pictures.draw();
    soon();
  });
}

const root = document.documentElement;
root.dataset.theme = matchMedia('(prefers-color-scheme: light)').matches ? 'light' : 'dark';
$('theme').addEventListener('click', () => {
  root.dataset.theme = root.dataset.theme === 'light' ? 'dark' : 'light';
  cloud.ask();
  soon();
});
new ResizeObserver(() => soon()).observe($('scale'));

async function refresh() {
  held.range = null;
  measuring.clear();
  try {
    const { details } = await get('state');
    settings.build(details);
  } catch (error) {
    note(error.message, true);
  }
  await records.refresh();
}

const query = new URLSearchParams(location.search);
if (query.has('stride')) {
  $('stride').value = query.get('stride');
  cloud.stride = Number(query.get('stride')) || 1;
}
try {
  await enter();
} catch (error) {
  note(error.message, true);
}
const link = new Link({
  hear,
  word: (type, what) => words[type]?.(what),
  state: (open) => (open ? refresh() : showState('bad', 'no connection to the server')),
});
link.show(wanted());
