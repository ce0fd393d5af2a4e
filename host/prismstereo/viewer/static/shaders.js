// The graphics card makes points of disparities: no vertex is ever sent to it.

const COMMON = `#version 300 es
precision highp float;
precision highp int;
precision highp usampler2D;
uniform usampler2D steps;
uniform sampler2D glass;
uniform sampler2D ramp;
uniform sampler2D picture;
uniform ivec2 size;        // of the map, pixels
uniform int stride;        // every so many pixels both ways
uniform vec4 pinhole;      // f, cx, cy, offset
uniform float scale;       // f times baseline
uniform vec2 ofGlass;      // middle and half of the disparities; half 0: no glass
uniform vec2 reach;        // nearest and farthest depth that is drawn
uniform vec2 colours;      // the disparities at both ends of the colours
uniform mat4 view;         // eye from camera
uniform vec2 lens;         // focal lengths of the eye, in half screens
uniform bool painted;      // by the picture, not by depth

float disparity(ivec2 at) {
  uint step = texelFetch(steps, at, 0).r;
  if (step == 0u) return -1.0;
  float d = float(step) / 16.0;
  if (ofGlass.y > 0.0) {
    vec2 map = texelFetch(glass, at, 0).rg;
    float e = (d - ofGlass.x) / ofGlass.y;
    d += e * (map.x + e * map.y);
  }
  return d;
}

float depth(ivec2 at) {
  float d = disparity(at);
  float total = d + pinhole.w;
  if (d < 0.0 || total <= 0.0) return 0.0;
  float z = scale / total;
  return z < reach.x || z > reach.y ? 0.0 : z;
}

vec3 point(ivec2 at, float z) {
  return vec3((vec2(at) - pinhole.yz) / pinhole.x * z, z);
}

vec3 colour(ivec2 at, float z) {
  if (painted) return texture(picture, (vec2(at) + 0.5) / vec2(size)).rgb;
  float d = scale / z - pinhole.w;
  return texture(ramp, vec2(clamp((d - colours.x) / (colours.y - colours.x), 0.0, 1.0) * 0.996 + 0.002, 0.5)).rgb;
}

vec4 project(vec3 p) {
  vec4 eye = view * vec4(p, 1.0);
  return vec4(eye.x * lens.x, -eye.y * lens.y, eye.z - 2.0 * nearest, eye.z);
}
`.replace('uniform bool painted;', 'uniform bool painted;\nuniform float nearest;');

export const POINTS = `${COMMON}
uniform float dotSize;         // half the screen's height in pixels, times the eye's focal length
out vec3 tint;
void main() {
  int columns = (size.x + stride - 1) / stride;
  ivec2 at = ivec2(gl_VertexID % columns, gl_VertexID / columns) * stride;
  float z = depth(at);
  tint = vec3(0.0);
  if (z == 0.0) {
    gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
    gl_PointSize = 0.0;
    return;
  }
  tint = colour(at, z);
  gl_Position = project(point(at, z));
  gl_PointSize = clamp(1.25 * dotSize * float(stride) * z / pinhole.x / gl_Position.w, 1.0, 24.0);
}`;

export const POINT_PIXELS = `#version 300 es
precision mediump float;
in vec3 tint;
out vec4 pixel;
void main() { pixel = vec4(tint, 1.0); }`;

// Two triangles to a cell; one whose corners lie apart in depth is left out: there is an edge, and nothing between.
export const MESH = `${COMMON}
uniform float jump;        // disparity between corners that is an edge
out vec3 tint;
out vec3 place;
const ivec2 CORNERS[6] = ivec2[6](ivec2(0, 0), ivec2(0, 1), ivec2(1, 0), ivec2(1, 0), ivec2(0, 1), ivec2(1, 1));
void main() {
  int columns = (size.x - 1) / stride;
  int cell = gl_VertexID / 6;
  int corner = gl_VertexID % 6;
  ivec2 base = ivec2(cell % columns, cell / columns) * stride;
  int first = corner < 3 ? 0 : 3;
  vec3 z;
  for (int i = 0; i < 3; i++) z[i] = depth(base + CORNERS[first + i] * stride);
  tint = place = vec3(0.0);
  float low = min(z.x, min(z.y, z.z));
  float high = max(z.x, max(z.y, z.z));
  if (low == 0.0 || scale / low - scale / high > jump) {
    gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
    return;
  }
  ivec2 at = base + CORNERS[corner] * stride;
  float own = z[corner - first];
  tint = colour(at, own);
  place = point(at, own);
  gl_Position = project(place);
}`;

export const MESH_PIXELS = `#version 300 es
precision highp float;
in vec3 tint;
in vec3 place;
out vec4 pixel;
void main() {
  vec3 normal = normalize(cross(dFdx(place), dFdy(place)));
  float light = 0.72 + 0.34 * abs(dot(normal, normalize(vec3(0.35, -0.5, -0.8))));
  pixel = vec4(tint * light, 1.0);
}`;
