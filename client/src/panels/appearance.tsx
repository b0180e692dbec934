// The selected BRDF by itself: the preview ball and a polar plot.
import { useSignal } from "@preact/signals";
import * as model from "../model";
import type { RGB } from "../messages";

const SIZE = 220;
const HALF = SIZE / 2;
const RADIUS = 100;
const FLOOR = 108;
const COLOURS = ["#e06c66", "#7fc07a", "#6d9fe0"];

export function AppearancePanel() {
  const data = model.appearance.value;
  const theta = useSignal(45);
  const log = useSignal(false);
  const current = data && data.object === model.selected.value[0] ? data : null;
  const radiance = current?.radiance ?? [];
  const peak = Math.max(1e-9, ...radiance.flat());
  const radius = (v: number) => {
    const f = v / peak;
    return RADIUS * (log.value ? Math.max(1 + Math.log10(Math.max(f, 1e-9)) / 3, 0) : f);
  };
  const outline = (k: number) =>
    radiance
      .map((v: RGB, i) => {
        const a = (current!.theta[i]! * Math.PI) / 180;
        const r = radius(v[k]!);
        return `${i ? "L" : "M"}${(HALF + r * Math.sin(a)).toFixed(1)} ${(FLOOR - r * Math.cos(a)).toFixed(1)}`;
      })
      .join("");
  const grey = radiance.every((v) => Math.abs(v[0] - v[1]) + Math.abs(v[1] - v[2]) <= 2e-3 * peak);
  const a = (theta.value * Math.PI) / 180;
  return (
    <div class="appearance">
      <figure class="ball" title="The material on a ball under a soft box">
        {current ? <img src={current.ball} alt={`Ball of ${current.object}`} /> : <div class="blank" />}
      </figure>
      <figure class="polar">
        <svg viewBox={`0 0 ${SIZE} 116`} role="img" aria-label="Polar plot of the reflected light in the plane of incidence">
          {[1, 0.5].map((f) => (
            <path key={f} class="grid" d={`M${HALF - RADIUS * f} ${FLOOR}A${RADIUS * f} ${RADIUS * f} 0 0 1 ${HALF + RADIUS * f} ${FLOOR}`} />
          ))}
          <line class="grid" x1={HALF - RADIUS} x2={HALF + RADIUS} y1={FLOOR} y2={FLOOR} />
          <line class="light" x1={HALF} y1={FLOOR} x2={HALF - RADIUS * Math.sin(a)} y2={FLOOR - RADIUS * Math.cos(a)} />
          {current &&
            (grey
              ? <path class="lobe" d={outline(1)} />
              : [0, 1, 2].map((k) => <path key={k} class="lobe" style={{ stroke: COLOURS[k] }} d={outline(k)} />))}
        </svg>
        <div class="caption">
          <label>
            θi
            <input
              type="range"
              min={0}
              max={85}
              value={theta.value}
              aria-label="Incidence angle of the polar plot"
              aria-valuetext={`${theta.value} degrees`}
              onInput={(event) => {
                theta.value = Number(event.currentTarget.value);
                model.inspect(theta.value);
              }}
            />
          </label>
          <span class="fixed-width">{theta.value}°</span>
          <button aria-pressed={log.value} onClick={() => (log.value = !log.value)} title="Logarithmic, three decades">
            Log
          </button>
        </div>
      </figure>
    </div>
  );
}
