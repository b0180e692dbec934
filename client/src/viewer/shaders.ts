// The shader of the viewer. Its tone curves are those of burnish/runtime/tonemap.py.
export const VERTEX = `#version 300 es
void main() {
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0;
  gl_Position = vec4(corner, 0.0, 1.0);
}`;

export const OPERATORS = ["srgb", "reinhard", "filmic", "aces", "agx"] as const;

/** What a draw needs of the shader. Each combination is a program of its own: branches that
 * are never taken are not free on a processor that draws in software. */
export interface Features {
  operator: number;
  comparison: number;
  outlines: boolean;
  grid: boolean;
  smaller: boolean;
}

export function fragment({ operator, comparison, outlines, grid, smaller }: Features): string {
  return `#version 300 es
#define OPERATOR ${operator}
#define COMPARISON ${comparison}
#define OUTLINES ${Number(outlines)}
#define GRID ${Number(grid)}
#define SMALLER ${Number(smaller)}
${SOURCE}`;
}

const SOURCE = `
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp usampler2D;

uniform sampler2D picture;
uniform sampler2D other;
uniform usampler2D objects;
uniform float height;
uniform vec2 size;
uniform vec2 corner;
uniform vec2 extent;
uniform vec2 origin;
uniform float zoom;
uniform vec3 gain;
uniform float wipe;
uniform int hovered;
uniform int selected;
uniform float glow;
uniform float thickness;
out vec4 colour;

#if OPERATOR == 0
vec3 tone(vec3 x) {
  return x;
}
#elif OPERATOR == 1
vec3 tone(vec3 x) {
  return x / (1.0 + dot(x, vec3(0.2126, 0.7152, 0.0722)));
}
#elif OPERATOR == 2
vec3 filmic(vec3 v) {
  const float a = 0.15, b = 0.50, c = 0.10, d = 0.20, e = 0.02, f = 0.30;
  return (v * (a * v + c * b) + d * e) / (v * (a * v + b) + d * f) - e / f;
}
vec3 tone(vec3 x) {
  return filmic(2.0 * x) / filmic(vec3(11.2));
}
#elif OPERATOR == 3
vec3 tone(vec3 x) {
  vec3 v = x * mat3(0.59719, 0.35458, 0.04823, 0.07600, 0.90834, 0.01566, 0.02840, 0.13383, 0.83777);
  v = (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081);
  return v * mat3(1.60475, -0.53108, -0.07367, -0.10208, 1.10813, -0.00605, -0.00327, -0.07276, 1.07602);
}
#elif OPERATOR == 4
const mat3 inset = mat3(
  0.842479062253094, 0.0784335999999992, 0.0792237451477643,
  0.0423282422610123, 0.878468636469772, 0.0791661274605434,
  0.0423756549057051, 0.0784336, 0.879142973793104);
vec3 tone(vec3 x) {
  vec3 v = log2(max(x * inset, 1e-10));
  v = (clamp(v, -12.47393, 4.026069) + 12.47393) / 16.499999;
  vec3 v2 = v * v, v4 = v2 * v2;
  v = 15.5 * v4 * v2 - 40.14 * v4 * v + 31.96 * v4 - 6.868 * v2 * v + 0.4298 * v2 + 0.1191 * v - 0.00232;
  return pow(clamp(v * inverse(inset), 0.0, 1.0), vec3(2.2));
}
#endif

// The sRGB transfer function. Its power as a polynomial in square roots, within 5e-5 of it:
// powers are what a processor that draws in software would spend its time on.
vec3 display(vec3 linear) {
  vec3 x = clamp(tone(max(linear, 0.0) * gain), 0.0, 1.0);
  vec3 a = sqrt(x), b = sqrt(a), c = sqrt(b);
  vec3 high = 0.6423761 * a + 0.7120982 * b - 0.3368648 * c - 0.0175665 * x;
  return mix(high, 12.92 * x, lessThanEqual(x, vec3(0.0031308)));
}

vec3 read(sampler2D image, vec2 p, vec2 whole) {
#if SMALLER
  return texture(image, p / whole).rgb;
#else
  return texelFetch(image, ivec2(p), 0).rgb;
#endif
}

bool compared(vec2 p) {
  return all(greaterThanEqual(p, corner)) && all(lessThan(p, corner + extent));
}

vec3 heat(float x) {
  x = clamp(x, 0.0, 1.0);
  return clamp(vec3(1.6 * x, 2.4 * x - 0.9, x < 0.4 ? 1.5 * x : 6.0 * (x - 0.75)), 0.0, 1.0);
}

#if OUTLINES
int object_at(vec2 p) {
  if (any(lessThan(p, vec2(0.0))) || any(greaterThanEqual(p, size))) return 0;
  return int(texelFetch(objects, ivec2(p), 0).r);
}

vec3 outlined(vec3 shown, vec2 p) {
  int id = object_at(p);
  if (id == 0 || (id != hovered && id != selected)) return shown;
  float step = thickness / zoom;
  bool inside = true;
  for (int i = 0; i < 8; i++) {
    float a = float(i) * 0.785398;
    inside = inside && object_at(p + step * vec2(cos(a), sin(a))) == id;
  }
  if (inside) return shown;
  return id == hovered ? mix(shown, vec3(1.0), 0.85) : mix(shown, vec3(0.95, 0.62, 0.2), glow);
}
#endif

void main() {
  vec2 p = (vec2(gl_FragCoord.x, height - gl_FragCoord.y) - origin) / zoom;
  vec3 shown;
#if COMPARISON == 0
  shown = display(read(picture, p, size));
#elif COMPARISON == 1
  // The line crosses what is compared, all of the picture or a part of it
  float edge = (corner.x + wipe * extent.x - p.x) * zoom;
  bool here = compared(p);
  shown = display(here && edge < 0.0 ? read(other, p - corner, extent) : read(picture, p, size));
  if (here && abs(edge) < 0.5 * thickness) shown = vec3(0.95);
#elif COMPARISON == 2
  shown = display(compared(p) ? read(other, p - corner, extent) : read(picture, p, size));
#else
  vec3 now = read(picture, p, size);
  if (compared(p)) {
    vec3 reference = read(other, p - corner, extent);
    shown = heat(2.0 * length(now - reference) / (length(reference) + 0.02));
  } else {
    shown = display(now);
  }
#endif
#if COMPARISON > 0
  vec2 beyond = max(corner - p, p - corner - extent) * zoom;
  float margin = max(beyond.x, beyond.y);
  if (margin > 0.0 && margin < 0.75 * thickness) shown = vec3(0.75);
#endif
#if OUTLINES
  shown = outlined(shown, p);
#endif
#if GRID
  vec2 inside = fract(p) * zoom;
  if (inside.x < 1.0 || inside.y < 1.0) shown = mix(shown, vec3(0.5), 0.25);
#endif
  colour = vec4(shown, 1.0);
}`;
