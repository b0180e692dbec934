// The one shader of the viewer. Its tone curves are those of burnish/runtime/tonemap.py.
export const VERTEX = `#version 300 es
void main() {
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0;
  gl_Position = vec4(corner, 0.0, 1.0);
}`;

export const OPERATORS = ["srgb", "reinhard", "filmic", "aces", "agx"] as const;

export const FRAGMENT = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp usampler2D;

uniform sampler2D picture;
uniform sampler2D other;
uniform usampler2D objects;
uniform vec2 canvas;
uniform vec2 size;
uniform vec2 origin;
uniform float zoom;
uniform vec3 gain;
uniform int operator;
uniform int comparison;
uniform float wipe;
uniform int hovered;
uniform int selected;
uniform float glow;
uniform float thickness;
uniform vec3 surround;
out vec4 colour;

vec3 filmic_curve(vec3 v) {
  const float a = 0.15, b = 0.50, c = 0.10, d = 0.20, e = 0.02, f = 0.30;
  return (v * (a * v + c * b) + d * e) / (v * (a * v + b) + d * f) - e / f;
}

vec3 aces(vec3 x) {
  vec3 v = x * mat3(0.59719, 0.35458, 0.04823, 0.07600, 0.90834, 0.01566, 0.02840, 0.13383, 0.83777);
  v = (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081);
  v = v * mat3(1.60475, -0.53108, -0.07367, -0.10208, 1.10813, -0.00605, -0.00327, -0.07276, 1.07602);
  return clamp(v, 0.0, 1.0);
}

vec3 agx(vec3 x) {
  const mat3 inset = mat3(
    0.842479062253094, 0.0784335999999992, 0.0792237451477643,
    0.0423282422610123, 0.878468636469772, 0.0791661274605434,
    0.0423756549057051, 0.0784336, 0.879142973793104);
  vec3 v = log2(max(x * inset, 1e-10));
  v = (clamp(v, -12.47393, 4.026069) + 12.47393) / 16.499999;
  vec3 v2 = v * v, v4 = v2 * v2;
  v = 15.5 * v4 * v2 - 40.14 * v4 * v + 31.96 * v4 - 6.868 * v2 * v + 0.4298 * v2 + 0.1191 * v - 0.00232;
  return pow(clamp(v * inverse(inset), 0.0, 1.0), vec3(2.2));
}

vec3 display(vec3 linear) {
  vec3 x = max(linear, 0.0) * gain;
  if (operator == 1) x = x / (1.0 + dot(x, vec3(0.2126, 0.7152, 0.0722)));
  else if (operator == 2) x = filmic_curve(2.0 * x) / filmic_curve(vec3(11.2));
  else if (operator == 3) x = aces(x);
  else if (operator == 4) x = agx(x);
  x = clamp(x, 0.0, 1.0);
  return mix(1.055 * pow(max(x, 1e-8), vec3(1.0 / 2.4)) - 0.055, 12.92 * x, lessThanEqual(x, vec3(0.0031308)));
}

vec3 read(sampler2D image, vec2 p) {
  return zoom >= 1.0 ? texelFetch(image, ivec2(p), 0).rgb : texture(image, p / size).rgb;
}

vec3 heat(float x) {
  x = clamp(x, 0.0, 1.0);
  return clamp(vec3(1.6 * x, 2.4 * x - 0.9, x < 0.4 ? 1.5 * x : 6.0 * (x - 0.75)), 0.0, 1.0);
}

int object_at(vec2 p) {
  if (any(lessThan(p, vec2(0.0))) || any(greaterThanEqual(p, size))) return 0;
  return int(texelFetch(objects, ivec2(p), 0).r);
}

float outline(int id, vec2 p) {
  if (id == 0 || object_at(p) != id) return 0.0;
  float step = thickness / zoom;
  for (int i = 0; i < 8; i++) {
    float a = float(i) * 0.785398;
    if (object_at(p + step * vec2(cos(a), sin(a))) != id) return 1.0;
  }
  return 0.0;
}

void main() {
  vec2 screen = vec2(gl_FragCoord.x, canvas.y - gl_FragCoord.y);
  vec2 p = (screen - origin) / zoom;
  if (any(lessThan(p, vec2(0.0))) || any(greaterThanEqual(p, size))) {
    colour = vec4(surround, 1.0);
    return;
  }
  vec3 linear = read(picture, p);
  vec3 shown;
  float edge = (wipe * size.x - p.x) * zoom;
  if (comparison == 3) {
    vec3 reference = read(other, p);
    float error = length(linear - reference) / (length(reference) + 0.02);
    shown = heat(2.0 * error);
  } else if (comparison == 2 || (comparison == 1 && edge < 0.0)) {
    shown = display(read(other, p));
  } else {
    shown = display(linear);
  }
  if (comparison == 1 && abs(edge) < 0.5 * thickness) shown = vec3(0.95);
  float ring = outline(hovered, p);
  shown = mix(shown, vec3(1.0), 0.85 * ring);
  ring = glow * outline(selected, p);
  shown = mix(shown, vec3(0.95, 0.62, 0.2), ring);
  if (zoom >= 14.0) {
    vec2 inside = fract(p) * zoom;
    if (inside.x < 1.0 || inside.y < 1.0) shown = mix(shown, vec3(0.5), 0.25);
  }
  colour = vec4(shown, 1.0);
}`;
