// The interpolation of burnish/materials/curve.py, so that a drag shows its curve at once.
import type { CurveData, RGB } from "./../messages";

/** The curve at each t: monotone cubic between points, constant beyond the ends. */
export function evaluate(curve: CurveData, at: number[]): RGB[] {
  const { t: x, values: y } = curve;
  const n = x.length;
  const first = y[0] ?? [1, 1, 1];
  if (n < 2) return at.map(() => first);
  const slopes = curve.interpolation === "cubic" ? slopesOf(x, y) : null;
  return at.map((t) => {
    const clamped = Math.min(Math.max(t, x[0]!), x[n - 1]!);
    let i = 0;
    while (i < n - 2 && clamped >= x[i + 1]!) i++;
    const h = x[i + 1]! - x[i]!;
    const u = (clamped - x[i]!) / h;
    const channel = (k: 0 | 1 | 2): number => {
      const [a, b] = [y[i]![k], y[i + 1]![k]];
      if (!slopes) return a + (b - a) * u;
      const value =
        (1 + 2 * u) * (1 - u) ** 2 * a +
        u * (1 - u) ** 2 * h * slopes[i]![k] +
        u * u * (3 - 2 * u) * b +
        u * u * (u - 1) * h * slopes[i + 1]![k];
      return Math.max(value, 0);
    };
    return [channel(0), channel(1), channel(2)];
  });
}

function slopesOf(x: number[], y: RGB[]): RGB[] {
  const n = x.length;
  const secant = (i: number, k: number) => (y[i + 1]![k]! - y[i]![k]!) / (x[i + 1]! - x[i]!);
  return x.map((_, i) => {
    const channel = (k: number): number => {
      if (i === 0) return secant(0, k);
      if (i === n - 1) return secant(n - 2, k);
      const [before, after] = [secant(i - 1, k), secant(i, k)];
      if (before * after <= 0) return 0;
      const [h0, h1] = [x[i]! - x[i - 1]!, x[i + 1]! - x[i]!];
      const [w1, w2] = [2 * h1 + h0, h1 + 2 * h0];
      return (w1 + w2) / (w1 / before + w2 / after);
    };
    return [channel(0), channel(1), channel(2)];
  });
}

/** The profile with the edit on it. */
export function applyCurve(curve: CurveData | null, t: number[], base: RGB[]): RGB[] {
  if (!curve) return base;
  const values = evaluate(curve, t);
  if (curve.mode === "replace") return values;
  return values.map((v, i) => {
    const b = base[i]!;
    return [v[0] * b[0], v[1] * b[1], v[2] * b[2]];
  });
}

/** One pass of a three-point filter over the values. */
export function smoothed(curve: CurveData): CurveData {
  const { values } = curve;
  const last = values.length - 1;
  const next = values.map((v, i): RGB => {
    const [a, b] = [values[Math.max(i - 1, 0)]!, values[Math.min(i + 1, last)]!];
    const mix = (k: 0 | 1 | 2) => 0.25 * a[k] + 0.5 * v[k] + 0.25 * b[k];
    return [mix(0), mix(1), mix(2)];
  });
  return { ...curve, values: next };
}
