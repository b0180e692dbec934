// Colour as the page needs it: sRGB encoding, hex, HSV, and the white of a temperature.
import type { RGB } from "./messages";

/** The sRGB transfer function (IEC 61966-2-1), for one channel of linear light. */
export function encode(x: number): number {
  const c = Math.min(Math.max(x, 0), 1);
  return c <= 0.0031308 ? 12.92 * c : 1.055 * c ** (1 / 2.4) - 0.055;
}

/** Its inverse on [0, 1]. */
export function decode(x: number): number {
  const c = Math.min(Math.max(x, 0), 1);
  return c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
}

export const toSrgb = (c: RGB): RGB => [encode(c[0]), encode(c[1]), encode(c[2])];
export const toLinear = (c: RGB): RGB => [decode(c[0]), decode(c[1]), decode(c[2])];

/** Linear RGB as #rrggbb in sRGB. */
export function hex(linear: RGB): string {
  return "#" + toSrgb(linear).map((x) => Math.round(x * 255).toString(16).padStart(2, "0")).join("");
}

/** #rgb or #rrggbb as linear RGB, or null. */
export function fromHex(text: string): RGB | null {
  const digits = text.trim().replace(/^#/, "");
  const long = digits.length === 3 ? [...digits].map((d) => d + d).join("") : digits;
  if (!/^[0-9a-f]{6}$/i.test(long)) return null;
  const part = (i: number) => parseInt(long.slice(i, i + 2), 16) / 255;
  return toLinear([part(0), part(2), part(4)]);
}

/** sRGB in [0, 1] to hue (degrees), saturation and value. */
export function toHsv([r, g, b]: RGB): RGB {
  const high = Math.max(r, g, b);
  const span = high - Math.min(r, g, b);
  if (span < 1e-6) return [0, 0, high];
  const sector =
    high === r ? ((g - b) / span + 6) % 6 : high === g ? (b - r) / span + 2 : (r - g) / span + 4;
  return [sector * 60, span / high, high];
}

/** The inverse of `toHsv`. */
export function fromHsv([h, s, v]: RGB): RGB {
  const f = (n: number) => {
    const k = (n + h / 60) % 6;
    return v - v * s * Math.max(0, Math.min(k, 4 - k, 1));
  };
  return [f(5), f(3), f(1)];
}

/**
 * The linear RGB of a white of that correlated colour temperature (kelvin, 1700 to 25000)
 * with a tint towards green (> 0) or magenta (< 0); 6500 K without tint is (1, 1, 1).
 * Planckian locus below 4000 K (Kim et al. 2002), CIE daylight above.
 */
export function whiteOf(kelvin: number, tint: number): RGB {
  const [x, y] = chromaticity(kelvin);
  const [x0, y0] = chromaticity(6500);
  const white = rgbOf(x, y);
  const neutral = rgbOf(x0, y0);
  const gain = 2 ** tint;
  const scaled: RGB = [white[0] / neutral[0], (white[1] / neutral[1]) * gain, white[2] / neutral[2]];
  const mean = (scaled[0] + scaled[1] + scaled[2]) / 3;
  return [scaled[0] / mean, scaled[1] / mean, scaled[2] / mean];
}

function chromaticity(kelvin: number): [number, number] {
  const t = 1000 / kelvin;
  if (kelvin < 4000) {
    const x = ((-0.2661239 * t - 0.2343589) * t + 0.8776956) * t + 0.17991;
    const y =
      kelvin < 2222
        ? ((-1.1063814 * x - 1.3481102) * x + 2.18555832) * x - 0.20219683
        : ((-0.9549476 * x - 1.37418593) * x + 2.09137015) * x - 0.16748867;
    return [x, y];
  }
  const x =
    kelvin <= 7000
      ? ((-4.607 * t + 2.9678) * t + 0.09911) * t + 0.244063
      : ((-2.0064 * t + 1.9018) * t + 0.24748) * t + 0.23704;
  return [x, (-3 * x + 2.87) * x - 0.275];
}

function rgbOf(x: number, y: number): RGB {
  const [X, Y, Z] = [x / y, 1, (1 - x - y) / y];
  const positive = (v: number) => Math.max(v, 0.02);
  return [
    positive(3.2404542 * X - 1.5371385 * Y - 0.4985314 * Z),
    positive(-0.969266 * X + 1.8760108 * Y + 0.041556 * Z),
    positive(0.0556434 * X - 0.2040259 * Y + 1.0572252 * Z),
  ];
}

/** Rec. 709 luminance. */
export const luminance = (r: number, g: number, b: number): number =>
  0.2126 * r + 0.7152 * g + 0.0722 * b;
