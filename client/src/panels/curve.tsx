// The curve of a layer over its coordinate: drag points, draw, smooth, by channel or all.
import { useComputed, useSignal } from "@preact/signals";
import { useRef } from "preact/hooks";
import { applyCurve, evaluate, smoothed } from "../controls/curve_maths";
import type { CurveData, LayerCurve, RGB } from "../messages";
import * as model from "../model";

const WIDTH = 300;
const HEIGHT = 150;
const LEFT = 4;
const BOTTOM = 16;
const POINTS = 9;
const MOST_HANDLES = 24;
const DECADES = 4;
const LARGEST_GAIN = 100;
const CHANNELS = ["all", "red", "green", "blue"] as const;
const COLOURS = ["#e06c66", "#7fc07a", "#6d9fe0"];

const NAMES: Record<string, string> = {
  theta_h: "θh half angle",
  theta_d: "θd difference angle",
  theta_r: "θr from the mirror direction",
  gamma_r: "γ from the mirror direction",
  theta_in: "θi incidence",
  theta_o: "θo viewing, from the normal",
  gamma: "γ, the half angle stretched",
  gamma_alpha: "γα, the half angle along u",
  gamma_beta: "γβ, the half angle along v",
};

export interface CurveEditorProps {
  /** What it is the curve of, said to screen readers. */
  name: string;
  coordinate: string;
  /** In degrees for an angle. */
  maximum: number;
  data: LayerCurve;
  curve: CurveData | null;
  set(curve: CurveData | null): void;
}

export function CurveEditor({ name, coordinate, maximum, data, curve, set }: CurveEditorProps) {
  const log = useSignal(false);
  const drawing = useSignal(false);
  const channel = useSignal<(typeof CHANNELS)[number]>("all");
  const held = useSignal<CurveData | null>(null);
  const heldPeak = useSignal(0);
  const svg = useRef<SVGSVGElement>(null);
  const active = held.value ?? curve;
  const result = applyCurve(active, data.t, data.base);
  const peakNow = Math.max(1e-6, ...result.flat(), ...data.base.flat());
  const peak = held.value ? heldPeak.value : peakNow * 1.12;
  const showLog = useComputed(() => log.value).value;

  const xOf = (t: number) => LEFT + t * (WIDTH - 2 * LEFT);
  const tOf = (x: number) => Math.min(Math.max((x - LEFT) / (WIDTH - 2 * LEFT), 0), 1);
  const span = HEIGHT - BOTTOM - 4;
  const yOf = (v: number) => {
    const f = showLog ? 1 + Math.log10(Math.max(v, 1e-30) / peak) / DECADES : v / peak;
    return 4 + span * (1 - Math.min(Math.max(f, 0), 1));
  };
  const vOf = (y: number) => {
    const f = Math.min(Math.max(1 - (y - 4) / span, 0), 1);
    return showLog ? (f <= 0 ? 0 : peak * 10 ** (DECADES * (f - 1))) : peak * f;
  };
  const line = (values: RGB[], k: number) =>
    values.map((v, i) => `${i ? "L" : "M"}${xOf(data.t[i]!).toFixed(1)} ${yOf(v[k]!).toFixed(1)}`).join("");
  const grey = result.every((v) => Math.abs(v[0] - v[1]) + Math.abs(v[1] - v[2]) <= 1e-4 * (v[0] + 1e-9));

  const which = channel.value === "all" ? [0, 1, 2] : [CHANNELS.indexOf(channel.value) - 1];
  const shownChannel = which.length === 3 ? 1 : which[0]!;
  const baseAt = (t: number): RGB => evaluate({ mode: "replace", interpolation: "linear", t: data.t, values: data.base }, [t])[0]!;
  const start = (): CurveData =>
    active ?? {
      mode: "gain",
      interpolation: "cubic",
      // As dense as the samples are: denser where the highlight is.
      t: Array.from({ length: POINTS }, (_, i) => data.t[Math.round((i * (data.t.length - 1)) / (POINTS - 1))]!),
      values: Array.from({ length: POINTS }, (): RGB => [1, 1, 1]),
    };
  const level = (mode: CurveData["mode"], t: number, v: number, k: number): number => {
    if (mode === "replace") return v;
    const base = baseAt(t)[k]!;
    return Math.min(base > 0 ? v / base : LARGEST_GAIN, LARGEST_GAIN);
  };
  const put = (next: CurveData) => {
    held.value = next;
    set(next);
  };
  const at = (event: PointerEvent): [number, number] => {
    const box = svg.current!.getBoundingClientRect();
    return [((event.clientX - box.left) / box.width) * WIDTH, ((event.clientY - box.top) / box.height) * HEIGHT];
  };
  const follow = (move: (event: PointerEvent) => void) => {
    model.beginDrag();
    heldPeak.value = peak;
    const stop = () => {
      window.removeEventListener("pointermove", move);
      window.removeEventListener("pointerup", stop);
      // The last value goes out with its own displayed frame, before the drag ends.
      requestAnimationFrame(() => {
        model.endDrag();
        held.value = null;
      });
    };
    window.addEventListener("pointermove", move);
    window.addEventListener("pointerup", stop);
  };

  const dragPoint = (index: number) => (event: PointerEvent) => {
    event.preventDefault();
    event.stopPropagation();
    const original = start();
    follow((e) => {
      const [x, y] = at(e);
      const t = [...original.t];
      const interior = index > 0 && index < t.length - 1;
      if (interior) t[index] = Math.min(Math.max(tOf(x), t[index - 1]! + 1e-3), t[index + 1]! - 1e-3);
      const values = original.values.map((v) => [...v] as RGB);
      for (const k of which) values[index]![k] = level(original.mode, t[index]!, vOf(y), k);
      put({ ...original, t, values });
    });
  };

  const draw = (event: PointerEvent) => {
    if (!drawing.value) return;
    event.preventDefault();
    const source = start();
    const values = (source.t.length > MOST_HANDLES ? source.values : evaluate(source, data.t)).map((v) => [...v] as RGB);
    const dense: CurveData = { ...source, t: source.t.length > MOST_HANDLES ? source.t : data.t, values };
    let last = at(event);
    const stroke = (e: PointerEvent) => {
      const next = at(e);
      const [a, b] = last[0] <= next[0] ? [last, next] : [next, last];
      const changed = dense.values.map((v, i): RGB => {
        const x = xOf(dense.t[i]!);
        if (x < a[0] - 1.5 || x > b[0] + 1.5) return v;
        const f = b[0] > a[0] ? Math.min(Math.max((x - a[0]) / (b[0] - a[0]), 0), 1) : 0.5;
        const value = vOf(a[1] + (b[1] - a[1]) * f);
        const copy = [...v] as RGB;
        for (const k of which) copy[k] = level(dense.mode, dense.t[i]!, value, k);
        return copy;
      });
      dense.values = changed;
      last = next;
      put({ ...dense });
    };
    follow(stroke);
    stroke(event);
  };

  const addPoint = (event: MouseEvent) => {
    if (drawing.value) return;
    const source = start();
    if (source.t.length >= MOST_HANDLES) return;
    const [x] = at(event as PointerEvent);
    const t = tOf(x);
    if (source.t.some((other) => Math.abs(other - t) < 2e-3)) return;
    const place = source.t.findIndex((other) => other > t);
    const i = place < 0 ? source.t.length : place;
    const value = evaluate(source, [t])[0]!;
    set({
      ...source,
      t: [...source.t.slice(0, i), t, ...source.t.slice(i)],
      values: [...source.values.slice(0, i), value, ...source.values.slice(i)],
    });
  };
  const removePoint = (index: number) => {
    const source = start();
    if (source.t.length <= 2) return;
    set({
      ...source,
      t: source.t.filter((_, i) => i !== index),
      values: source.values.filter((_, i) => i !== index),
    });
  };
  const nudge = (index: number) => (event: KeyboardEvent) => {
    if (event.key === "Delete" || event.key === "Backspace") removePoint(index);
    else if (event.key === "ArrowUp" || event.key === "ArrowDown") {
      const factor = event.key === "ArrowUp" ? 1.05 : 1 / 1.05;
      const source = start();
      const values = source.values.map((v) => [...v] as RGB);
      for (const k of which) values[index]![k] = Math.min((values[index]![k] || 0.01) * factor, 1e6);
      set({ ...source, values });
    } else return;
    event.preventDefault();
    event.stopPropagation();
  };
  const standAlone = active?.mode === "replace";
  const switchMode = () => {
    const source = start();
    if (standAlone) {
      const dense = data.t.map((t, i): RGB => {
        const v = result[i]!;
        return [level("gain", t, v[0], 0), level("gain", t, v[1], 1), level("gain", t, v[2], 2)];
      });
      set({ mode: "gain", interpolation: "cubic", t: data.t, values: dense });
    } else {
      set({ ...source, mode: "replace", t: data.t, values: result });
    }
  };

  const points = start();
  const handles = !drawing.value && points.t.length <= MOST_HANDLES;
  const handleValues = handles ? applyCurve(points, points.t, points.t.map(baseAt)) : [];
  const ticks = [0, 0.25, 0.5, 0.75, 1];
  return (
    <div class="curve">
      <div class="tools" role="toolbar" aria-label={`Curve of ${name}`}>
        <button aria-pressed={!drawing.value} title="Drag points; double-click adds one, Delete removes it" onClick={() => (drawing.value = false)}>
          Points
        </button>
        <button aria-pressed={drawing.value} title="Draw the curve freehand" onClick={() => (drawing.value = true)}>
          Draw
        </button>
        <select aria-label="Channel" value={channel.value} onChange={(e) => (channel.value = e.currentTarget.value as "all")}>
          {CHANNELS.map((name) => (
            <option key={name} value={name}>
              {name}
            </option>
          ))}
        </select>
        <button aria-pressed={showLog} title="Logarithmic heights, four decades" onClick={() => (log.value = !log.value)}>
          Log
        </button>
        <span class="spacer" />
        <button disabled={!curve} title="Smooth the freehand edit" onClick={() => curve && set(smoothed(curve))}>
          Smooth
        </button>
        <button disabled={!curve} title="Remove the freehand edit; the parameters' curve stays" onClick={() => set(null)}>
          Remove
        </button>
      </div>
      <svg
        ref={svg}
        class={drawing.value ? "drawing" : ""}
        viewBox={`0 0 ${WIDTH} ${HEIGHT}`}
        role="group"
        aria-label={`Curve of ${name} over ${coordinate}, 0 to ${maximum.toFixed(0)} degrees`}
        onPointerDown={draw}
        onDblClick={addPoint}
      >
        {ticks.map((f) => (
          <g key={f}>
            <line class="grid" x1={xOf(f)} x2={xOf(f)} y1={4} y2={HEIGHT - BOTTOM} />
            <text x={xOf(f)} y={HEIGHT - 4} text-anchor={f === 0 ? "start" : f === 1 ? "end" : "middle"}>
              {(f * maximum).toFixed(maximum < 10 ? 1 : 0)}°
            </text>
          </g>
        ))}
        <text class="peak" x={WIDTH - 6} y={14} text-anchor="end">
          {peakNow.toPrecision(3)}
        </text>
        {active && <path class="base" d={line(data.base, shownChannel)} />}
        {grey ? (
          <path class="result" d={line(result, 1)} />
        ) : (
          [0, 1, 2].map((k) => <path key={k} class="result" style={{ stroke: COLOURS[k] }} d={line(result, k)} />)
        )}
        {handles &&
          points.t.map((t, i) => (
            <circle
              key={i}
              class="handle"
              data-point={i}
              cx={xOf(t)}
              cy={yOf(handleValues[i]![shownChannel]!)}
              r={4}
              tabindex={0}
              role="slider"
              aria-label={`Point ${i + 1} at ${(t * maximum).toFixed(1)} degrees`}
              aria-valuenow={Number(handleValues[i]![shownChannel]!.toPrecision(4))}
              onPointerDown={dragPoint(i)}
              onDblClick={(e) => {
                e.stopPropagation();
                if (curve) removePoint(i);
              }}
              onKeyDown={nudge(i)}
            />
          ))}
      </svg>
      <div class="caption">
        <span>{NAMES[coordinate] ?? coordinate}</span>
        <label title="On: the drawn curve stands by itself. Off: it scales the parameters' curve, which goes on moving under it.">
          <input type="checkbox" checked={standAlone} onChange={switchMode} /> stands alone
        </label>
      </div>
    </div>
  );
}
