// The connection with the server: one message of each kind at a time, acknowledged when it is unpacked.

import { parse } from './unpack.js';

const BEAT_MS = 10000;
const LONGEST_WAIT_MS = 5000;

/** Show the token that stands behind the # of the address, once, and take it out of there. */
export async function enter() {
  const token = new URLSearchParams(location.hash.slice(1)).get('token');
  if (!token) return;
  history.replaceState(null, '', location.pathname + location.search);
  await post('enter', { token });
}

/** Ask the server to do something; throws an Error with its words. */
export async function post(action, what = {}) {
  const answer = await fetch(`/api/${action}`, {
    method: 'POST',
    headers: { 'Content-Type': 'application/json' },
    body: JSON.stringify(what),
  });
  return read(answer);
}

export async function get(what) {
  return read(await fetch(`/api/${what}`));
}

async function read(answer) {
  if (answer.headers.get('Content-Type') !== 'application/json') throw new Error(await answer.text());
  const said = await answer.json();
  if (!answer.ok) throw new Error(said.error ?? answer.statusText);
  return said;
}

export class Link {
  /** `hear(kind, head, body, bytes)` may be async; `word(type, what)` and `state(open)` are not. */
  constructor({ hear, word, state }) {
    Object.assign(this, { hear, word, state });
    this.shown = [];
    this.wait = 250;
    this.connect();
    setInterval(() => this.say({}), BEAT_MS);
  }

  connect() {
    const socket = new WebSocket(`${location.protocol === 'https:' ? 'wss' : 'ws'}://${location.host}/live`);
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => {
      this.wait = 250;
      this.state(true);
      this.say({ show: this.shown });
    };
    socket.onclose = () => {
      this.state(false);
      setTimeout(() => this.connect(), this.wait);
      this.wait = Math.min(2 * this.wait, LONGEST_WAIT_MS);
    };
    socket.onmessage = ({ data }) => (typeof data === 'string' ? this.listen(data) : this.take(data));
    this.socket = socket;
  }

  listen(text) {
    const { type, what } = JSON.parse(text);
    this.word(type, what);
  }

  async take(buffer) {
    const { kind, head, body } = parse(buffer);
    try {
      await this.hear(kind, head, body, buffer.byteLength);
    } catch (error) {
      this.word('note', `A message could not be shown: ${error.message}`);
    }
    this.say({ ack: [kind] });
  }

  show(names) {
    this.shown = names;
    this.say({ show: names });
  }

  say(what) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(what));
  }
}
