// Recordings and captured sessions, and the time line of the one that is played.

import { get, post } from './link.js';
import { time } from './panels.js';
import { text } from './settings.js';

const $ = (id) => document.getElementById(id);

export class Records {
  constructor({ list, live, note, changed }) {
    Object.assign(this, { list, live, note, changed, dragging: false });
    const seek = $('seek');
    seek.addEventListener('input', () => {
      this.dragging = true;
      $('moment').textContent = time(Number(seek.value));
    });
    seek.addEventListener('change', () => this.play(this.playing, Number(seek.value)));
  }

  async refresh() {
    try {
      const { records } = await get('records');
      this.list.replaceChildren(...records.map((record) => this.row(record)));
      if (!records.length) this.list.append(text('li', 'None yet.', 'quiet'));
    } catch (error) {
      this.note(error.message, true);
    }
  }

  row(record) {
    const row = document.createElement('li');
    const name = text('span', record.name);
    name.title = record.name;
    row.append(name, text('small', record.kind === 'recording' ? `${(record.bytes / 1e6).toFixed(1)} MB` : 'session'));
    if (record.kind === 'recording') {
      const button = text('button', 'Play');
      button.setAttribute('aria-label', `Play ${record.name}`);
      button.addEventListener('click', () => this.play(record.name, 0));
      row.append(button);
    } else {
      for (const place of record.pictures) {
        const way = text('a', place.split('/')[0] === 'background' ? 'bg' : String(Number(place.slice(-10, -4))));
        Object.assign(way, { href: `/files/${record.name}/${place}`, target: '_blank', rel: 'noopener' });
        way.setAttribute('aria-label', `${place} of ${record.name}`);
        row.append(way);
      }
    }
    return row;
  }

  async play(name, start) {
    try {
      await post('play', { name, position_s: start });
      if (name !== this.playing) await this.changed();
    } catch (error) {
      this.note(error.message, true);
    } finally {
      this.dragging = false;
    }
  }

  status(status) {
    const { playback } = status;
    this.live.hidden = !playback || !status.can_go_live;
    $('timeline').hidden = !playback;
    this.playing = playback?.name ?? null;
    if (!playback) return;
    $('pause').setAttribute('aria-pressed', String(playback.paused));
    $('pause').textContent = playback.paused ? 'Go on' : 'Pause';
    $('seek').max = playback.length_s;
    $('length').textContent = time(playback.length_s);
    if (!this.dragging) {
      $('seek').value = playback.position_s;
      $('moment').textContent = time(playback.position_s);
    }
  }
}
