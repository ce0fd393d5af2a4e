// Looking around a cloud: by mouse, by touch, by keyboard.

const TURN = 0.006;
const KEY_TURN = 0.08;
const MOST_PITCH = 1.45;

export class Orbit {
  /** `changed` is called when the view is another; `tapped(x, y)` for a click that was no drag. */
  constructor(canvas, changed, tapped) {
    Object.assign(this, { canvas, changed, tapped, touches: new Map(), moved: 0, home: null });
    this.target = [0, 0, 1000];
    this.away = 1400;
    this.reset();
    canvas.addEventListener('pointerdown', (event) => this.down(event));
    canvas.addEventListener('pointermove', (event) => this.move(event));
    for (const end of ['pointerup', 'pointercancel']) canvas.addEventListener(end, (event) => this.up(event));
    canvas.addEventListener('wheel', (event) => this.wheel(event), { passive: false });
    canvas.addEventListener('keydown', (event) => this.key(event));
    canvas.addEventListener('dblclick', () => this.reset());
  }

  /** Where to look when nothing was turned yet. */
  frame(target, away) {
    this.home = { target, away };
    if (!this.touched) {
      this.target = [...target];
      this.away = away;
    }
  }

  reset() {
    this.yaw = 0.5;
    this.pitch = 0.26;
    this.touched = false;
    if (this.home) this.frame(this.home.target, this.home.away);
    this.changed();
  }

  /** Eye from camera, column by column. */
  matrix() {
    const [cy, sy, cp, sp] = [Math.cos(this.yaw), Math.sin(this.yaw), Math.cos(this.pitch), Math.sin(this.pitch)];
    const R = [
      [cy, 0, -sy],
      [-sp * sy, cp, -sp * cy],
      [cp * sy, sp, cp * cy],
    ];
    const shift = R.map((row) => -row.reduce((sum, part, i) => sum + part * this.target[i], 0));
    shift[2] += this.away;
    return [R[0][0], R[1][0], R[2][0], 0, R[0][1], R[1][1], R[2][1], 0, R[0][2], R[1][2], R[2][2], 0, ...shift, 1];
  }

  turn(dx, dy) {
    this.touched = true;
    this.yaw += dx;
    this.pitch = Math.max(-MOST_PITCH, Math.min(MOST_PITCH, this.pitch + dy));
    this.changed();
  }

  zoom(factor) {
    this.touched = true;
    const home = this.home?.away ?? this.away;
    this.away = Math.max(home / 50, Math.min(home * 20, this.away * factor));
    this.changed();
  }

  pan(dx, dy) {
    this.touched = true;
    const m = this.matrix();
    const step = this.away / this.canvas.clientHeight;
    for (let i = 0; i < 3; i++) this.target[i] -= step * (dx * m[4 * i] + dy * m[4 * i + 1]);
    this.changed();
  }

  down(event) {
    if (this.touches.size === 0) this.moved = 0;
    this.canvas.setPointerCapture(event.pointerId);
    this.touches.set(event.pointerId, { x: event.clientX, y: event.clientY });
  }

  move(event) {
    const before = this.touches.get(event.pointerId);
    if (!before) return;
    const now = { x: event.clientX, y: event.clientY };
    const [dx, dy] = [now.x - before.x, now.y - before.y];
    this.moved += Math.abs(dx) + Math.abs(dy);
    if (this.touches.size === 1) {
      if (event.shiftKey || event.buttons === 2 || event.buttons === 4) this.pan(dx, dy);
      else this.turn(dx * TURN, dy * TURN);
    } else {
      const [, other] = [...this.touches.entries()].find(([id]) => id !== event.pointerId);
      this.pan(dx / 2, dy / 2);
      const apart = (one) => Math.hypot(one.x - other.x, one.y - other.y) + 1;
      this.zoom(apart(before) / apart(now));
    }
    this.touches.set(event.pointerId, now);
  }

  up(event) {
    if (!this.touches.delete(event.pointerId) || event.type === 'pointercancel') return;
    if (this.touches.size === 0 && this.moved < 5) this.tapped(event.offsetX, event.offsetY);
  }

  wheel(event) {
    event.preventDefault();
    this.zoom(Math.exp(event.deltaY * 0.0012));
  }

  key(event) {
    const step = event.shiftKey ? 24 : 0;
    const ways = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    const way = ways[event.key];
    if (way && step) this.pan(way[0] * step, way[1] * step);
    else if (way) this.turn(way[0] * KEY_TURN, -way[1] * KEY_TURN);
    else if (event.key === '+' || event.key === '=') this.zoom(0.85);
    else if (event.key === '-') this.zoom(1 / 0.85);
    else if (event.key === '0' || event.key === 'Home') this.reset();
    else return;
    event.preventDefault();
  }
}
