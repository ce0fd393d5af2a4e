// Points and mesh of the newest frame, drawn by WebGL 2; what is written over them is a plain canvas.

import { table } from './colours.js';
import { Orbit } from './orbit.js';
import { MESH, MESH_PIXELS, POINTS, POINT_PIXELS } from './shaders.js';

const EYE = 2.6; // focal length of the eye, in half screen heights
const FILL = 0.95; // of the canvas
const AIM = 14; // pixels around a click in which a point is looked for
const EDGE_PX = 2; // disparity that no surface changes by between neighbours, per pixel of the stride

export class Cloud {
  constructor(canvas, over, picked) {
    const gl = canvas.getContext('webgl2', { antialias: false, alpha: true, premultipliedAlpha: true });
    Object.assign(this, { canvas, over, gl, frame: null, mesh: false, painted: false, stride: 1, map: 'viridis', picks: [] });
    this.orbit = new Orbit(canvas, () => this.ask(), (x, y) => this.tap(x, y, picked));
    this.drawn = 0;
    if (gl) {
      this.points = program(gl, POINTS, POINT_PIXELS);
      this.surface = program(gl, MESH, MESH_PIXELS);
      this.textures = { steps: gl.createTexture(), glass: gl.createTexture(), ramp: gl.createTexture(), picture: gl.createTexture() };
      gl.bindVertexArray(gl.createVertexArray());
      gl.enable(gl.DEPTH_TEST);
      this.paintRamp();
      upload(gl, this.textures.glass, gl.RG32F, 1, 1, gl.RG, gl.FLOAT, new Float32Array(2));
      upload(gl, this.textures.picture, gl.RGBA8, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array([160, 160, 160, 255]), true);
    }
    new ResizeObserver(() => this.ask()).observe(canvas);
  }

  get works() {
    return this.gl !== null;
  }

  setMap(name) {
    this.map = name;
    this.paintRamp();
    this.ask();
  }

  paintRamp() {
    const { gl } = this;
    if (gl) upload(gl, this.textures.ramp, gl.RGBA8, 256, 1, gl.RGBA, gl.UNSIGNED_BYTE, table(this.map), true);
  }

  setFrame(frame, range) {
    const { gl } = this;
    if (!gl) return;
    const first = this.frame === null;
    if (frame.glass && frame.glass !== this.glass) {
      upload(gl, this.textures.glass, gl.RG32F, frame.width, frame.height, gl.RG, gl.FLOAT, frame.glass.maps);
    }
    this.glass = frame.glass;
    upload(gl, this.textures.steps, gl.R16UI, frame.width, frame.height, gl.RED_INTEGER, gl.UNSIGNED_SHORT, frame.steps);
    Object.assign(this, { frame, range });
    if (frame.metric) this.look(first);
    this.ask();
  }

  /** Put the view where all of it is seen, as long as nobody turned it. */
  look() {
    const { frame, range, canvas } = this;
    const far = Math.min(frame.depth(range[0]) * 1.1, 8 * frame.depth(range[1]));
    const seen = [[], [], []];
    for (let y = 4; y < frame.height; y += 12) {
      for (let x = 4; x < frame.width; x += 12) {
        const z = frame.depthAt(y * frame.width + x);
        if (z < far) frame.ray(x, y).forEach((part, i) => seen[i].push(part * z));
      }
    }
    if (seen[2].length < 20) return;
    const ends = seen.map((values) => {
      values.sort((a, b) => a - b);
      return [values[Math.floor(0.02 * values.length)], values[Math.ceil(0.98 * values.length) - 1]];
    });
    const target = ends.map(([low, high]) => (low + high) / 2);
    const away = this.fitting(ends, target);
    const home = this.orbit.home;
    if (home && Math.abs(home.away / away - 1) < 0.1) return; // calm: small changes do not move the eye
    this.orbit.frame(target, away);
  }

  /** How far away the eye has to be for nearly all of the points: for the corners of their box. */
  fitting(ends, target) {
    const m = this.orbit.matrix();
    const wide = this.canvas.clientHeight / Math.max(1, this.canvas.clientWidth);
    let away = 0;
    for (let corner = 0; corner < 8; corner++) {
      const p = ends.map(([low, high], i) => (corner & (1 << i) ? high : low) - target[i]);
      const [x, y, z] = [0, 1, 2].map((row) => m[row] * p[0] + m[4 + row] * p[1] + m[8 + row] * p[2]);
      away = Math.max(away, (Math.abs(x) * EYE * wide) / FILL - z, (Math.abs(y) * EYE) / FILL - z);
    }
    return away;
  }

  setPicture(bitmap) {
    const { gl } = this;
    if (!gl) return;
    gl.bindTexture(gl.TEXTURE_2D, this.textures.picture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, bitmap);
    smooth(gl);
    if (this.painted) this.ask();
  }

  ask() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => {
      this.asked = false;
      this.draw();
    });
  }

  draw() {
    const { gl, canvas, frame } = this;
    const ratio = Math.min(devicePixelRatio || 1, 2);
    const [width, height] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
    if (!gl || !width || !height) return;
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    if (frame && frame.metric) {
      const shape = this.mesh ? this.surface : this.points;
      this.set(shape, width, height);
      const across = Math.ceil(frame.width / this.stride);
      const down = Math.ceil(frame.height / this.stride);
      if (this.mesh) {
        const cells = Math.floor((frame.width - 1) / this.stride) * Math.floor((frame.height - 1) / this.stride);
        gl.drawArrays(gl.TRIANGLES, 0, 6 * cells);
      } else gl.drawArrays(gl.POINTS, 0, across * down);
      this.drawn++;
    }
    this.write();
  }

  set(shape, width, height) {
    const { gl, frame, range } = this;
    const { focal_px: f, cx_px: cx, cy_px: cy } = frame.head.projection;
    gl.useProgram(shape.program);
    const at = shape.uniforms;
    ['steps', 'glass', 'ramp', 'picture'].forEach((name, unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, this.textures[name]);
      gl.uniform1i(at[name], unit);
    });
    gl.uniform2i(at.size, frame.width, frame.height);
    gl.uniform1i(at.stride, this.stride);
    gl.uniform4f(at.pinhole, f, cx, cy, frame.head.offset_px);
    gl.uniform1f(at.scale, frame.head.scale_px);
    gl.uniform2f(at.ofGlass, frame.glass?.middle_px ?? 0, frame.glass?.half_px ?? 0);
    const [near, far] = [frame.depth(range[1]), frame.depth(range[0])];
    gl.uniform2f(at.reach, 0.85 * near, Math.min(1.25 * far, 12 * near));
    gl.uniform2f(at.colours, range[0], range[1]);
    gl.uniformMatrix4fv(at.view, false, this.orbit.matrix());
    gl.uniform2f(at.lens, (EYE * height) / width, EYE);
    gl.uniform1f(at.nearest, this.orbit.away / 100);
    gl.uniform1i(at.painted, this.painted ? 1 : 0);
    gl.uniform1f(at.dotSize, (EYE * height) / 2);
    gl.uniform1f(at.jump, EDGE_PX * this.stride);
  }

  /** Take a point of the camera's frame to the canvas, in CSS pixels; null behind the eye. */
  toScreen(point) {
    const m = this.orbit.matrix();
    const eye = [0, 1, 2].map((row) => m[row] * point[0] + m[4 + row] * point[1] + m[8 + row] * point[2] + m[12 + row]);
    if (eye[2] <= 0) return null;
    const { clientWidth: w, clientHeight: h } = this.canvas;
    return [w / 2 + (EYE * h * eye[0]) / eye[2] / 2, h / 2 + (EYE * h * eye[1]) / eye[2] / 2, eye[2]];
  }

  tap(x, y, picked) {
    const { frame } = this;
    if (!frame || !frame.metric) return;
    let best = null;
    const stride = Math.max(2, this.stride);
    for (let row = 0; row < frame.height; row += stride) {
      for (let column = 0; column < frame.width; column += stride) {
        const z = frame.depthAt(row * frame.width + column);
        if (!Number.isFinite(z)) continue;
        const seen = this.toScreen(frame.ray(column, row).map((part) => part * z));
        if (!seen) continue;
        const off = Math.hypot(seen[0] - x, seen[1] - y);
        if (off < AIM && (!best || off + seen[2] / 100 < best.cost)) best = { cost: off + seen[2] / 100, column, row };
      }
    }
    if (best) picked(best.column, best.row);
  }

  /** Write the camera and what was picked over the cloud. */
  write() {
    const { over, canvas, frame } = this;
    const ratio = Math.min(devicePixelRatio || 1, 2);
    over.width = Math.round(canvas.clientWidth * ratio);
    over.height = Math.round(canvas.clientHeight * ratio);
    const pen = over.getContext('2d');
    pen.scale(ratio, ratio);
    if (!frame || !frame.metric) return;
    const style = getComputedStyle(over);
    this.writeCamera(pen, style.getPropertyValue('--muted'));
    this.writePicks(pen, style.getPropertyValue('--accent'));
  }

  writeCamera(pen, colour) {
    const { frame, range } = this;
    const z = 0.16 * frame.depth(range[1]);
    const corners = [[0, 0], [frame.width - 1, 0], [frame.width - 1, frame.height - 1], [0, frame.height - 1]];
    const seen = corners.map(([x, y]) => this.toScreen(frame.ray(x, y).map((part) => part * z)));
    const eye = this.toScreen([0, 0, 0]);
    if (!eye || seen.some((one) => !one)) return;
    pen.strokeStyle = colour;
    pen.globalAlpha = 0.7;
    pen.beginPath();
    seen.forEach((one, i) => {
      const next = seen[(i + 1) % 4];
      pen.moveTo(one[0], one[1]);
      pen.lineTo(next[0], next[1]);
      pen.moveTo(eye[0], eye[1]);
      pen.lineTo(one[0], one[1]);
    });
    pen.stroke();
    pen.globalAlpha = 1;
  }

  writePicks(pen, colour) {
    const places = this.picks.map((one) => this.toScreen(one.point)).filter(Boolean);
    pen.strokeStyle = colour;
    pen.lineWidth = 2;
    pen.beginPath();
    if (places.length === 2) {
      pen.moveTo(places[0][0], places[0][1]);
      pen.lineTo(places[1][0], places[1][1]);
    }
    for (const [x, y] of places) {
      pen.moveTo(x + 6, y);
      pen.arc(x, y, 6, 0, 2 * Math.PI);
    }
    pen.stroke();
  }
}

function upload(gl, texture, inner, width, height, format, type, data, blended = false) {
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  gl.texImage2D(gl.TEXTURE_2D, 0, inner, width, height, 0, format, type, data);
  if (blended) smooth(gl);
  else {
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  }
}

function smooth(gl) {
  for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, side, gl.LINEAR);
  for (const way of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, way, gl.CLAMP_TO_EDGE);
}

function program(gl, vertices, pixels) {
  const made = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertices], [gl.FRAGMENT_SHADER, pixels]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
  const uniforms = {};
  for (let i = 0; i < gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS); i++) {
    const { name } = gl.getActiveUniform(made, i);
    uniforms[name] = gl.getUniformLocation(made, name);
  }
  return { program: made, uniforms };
}
