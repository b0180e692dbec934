// Under the picture: pixel values, histogram, zoom, progress.
import { useEffect, useRef } from "preact/hooks";
import { encode, luminance } from "../colour";
import { Kind, type Frame } from "../frames";
import { HALF } from "../halves";
import * as model from "../model";
import { gainOf } from "../viewer/view";

const STOPS_LOW = -8;
const STOPS_HIGH = 4;
const BINS = 96;
/** Pixels that the histogram looks at: enough for its bars' height in screen pixels. */
const SAMPLES = 16000;
const PAUSE_MS = 200;
const NOISE =
  "Relative error (root mean square, linear light, without lamps in view) that noise leaves in the picture before denoising: " +
  "estimated from how much the last two published pictures differ, and falling with the square root of the samples";

export function StatusBar() {
  const probe = model.probe.value;
  const progress = model.progress.value;
  const lost = model.link.value !== "open";
  return (
    <footer class="statusbar">
      <span class={lost ? "link lost" : "link"} role="status">
        {{ open: "", connecting: "Connecting …", lost: "Connection lost; trying again …", outdated: "This page is outdated: reload it." }[model.link.value]}
      </span>
      {probe ? (
        <span class="probe">
          <b>
            {probe.x}, {probe.y}
          </b>
          <span class="chip" style={{ background: `rgb(${probe.linear.map((x) => Math.round(255 * encode(x))).join()})` }} />
          linear {probe.linear.map((x) => x.toPrecision(4)).join("  ")}
          <span class="faint">sRGB {probe.linear.map((x) => Math.round(255 * encode(x))).join(" ")}</span>
          <span class="faint">{probe.object || "no editable object"}</span>
        </span>
      ) : (
        <span class="probe faint">Point at the picture for pixel values</span>
      )}
      <span class="spacer" />
      {progress?.text && (
        <span class="refining" title="Samples per pixel of the live picture; it goes on refining, and edits keep every sample of the selected object">
          {progress.text}
        </span>
      )}
      {progress && progress.noise >= 0 && (
        <span class="noise" title={NOISE}>
          noise ±{(progress.noise * 100).toPrecision(2)} %
        </span>
      )}
      <DenoiseToggle />
      {progress && progress.fraction >= 0 && progress.fraction < 1 && <progress max={1} value={progress.fraction} />}
      {progress && progress.frames_per_second > 0 && <span class="fixed-width">{progress.frames_per_second.toFixed(0)} fps</span>}
      <span class="fixed-width" title="Picture pixels to screen pixels (F fits, 1 shows them one to one)">
        {(model.zoom.value * 100).toFixed(0)} %
      </span>
      <button aria-pressed={model.histogramOpen.value} title="Histogram (G)" onClick={() => (model.histogramOpen.value = !model.histogramOpen.value)}>
        Histogram
      </button>
    </footer>
  );
}

/** Whether live pictures are denoised while nothing is edited. */
function DenoiseToggle() {
  const missing = model.welcome.value?.denoiser ?? "";
  const on = !missing && (model.progress.value?.denoise ?? false);
  return (
    <button
      aria-pressed={on}
      disabled={!!missing}
      title={missing || "Denoise the picture at rest while it is noisy; never what is dragged, saved or compared (D)"}
      onClick={model.toggleDenoise}
    >
      Denoise at rest
    </button>
  );
}

/** Counts of each channel over stops of displayed linear light, at most five times a second. */
export function Histogram() {
  const canvas = useRef<HTMLCanvasElement>(null);
  useEffect(() => {
    let latest: Frame | null = null;
    let timer = 0;
    const draw = () => {
      timer = 0;
      if (latest && canvas.current) paint(canvas.current, latest);
    };
    const schedule = () => {
      if (!timer) timer = window.setTimeout(draw, PAUSE_MS);
    };
    const stop = model.onFrame((frame) => {
      if (frame.kind !== Kind.Picture) return;
      latest = frame;
      schedule();
    });
    const stopGain = [model.exposure, model.temperature, model.pickedWhite].map((s) => s.subscribe(schedule));
    return () => {
      stop();
      for (const end of stopGain) end();
      clearTimeout(timer);
    };
  }, []);
  return (
    <figure class="histogram" title={`Displayed linear light, ${STOPS_LOW} to +${STOPS_HIGH} stops; the line marks 1`}>
      <canvas ref={canvas} width={2 * BINS} height={56} role="img" aria-label="Histogram" />
    </figure>
  );
}

function paint(canvas: HTMLCanvasElement, frame: Frame): void {
  const gain = gainOf();
  const counts = [0, 1, 2, 3].map(() => new Float32Array(BINS));
  const { pixels } = frame;
  const total = pixels.length / 3;
  // Odd, so that no column of the picture is left out.
  const step = Math.max(Math.floor(total / SAMPLES), 1) | 1;
  for (let i = 0; i < total; i += step) {
    const r = HALF[pixels[3 * i]!]! * gain[0];
    const g = HALF[pixels[3 * i + 1]!]! * gain[1];
    const b = HALF[pixels[3 * i + 2]!]! * gain[2];
    const values = [r, g, b, luminance(r, g, b)];
    for (let k = 0; k < 4; k++) {
      const stop = Math.log2(Math.max(values[k]!, 1e-9));
      const bin = Math.floor(((stop - STOPS_LOW) / (STOPS_HIGH - STOPS_LOW)) * BINS);
      counts[k]![Math.min(Math.max(bin, 0), BINS - 1)]! += 1;
    }
  }
  const context = canvas.getContext("2d");
  if (!context) return;
  const { width, height } = canvas;
  context.clearRect(0, 0, width, height);
  // The bins at both ends hold what lies beyond them and would flatten the rest.
  const peak = Math.max(1, ...counts.flatMap((c) => [...c.subarray(1, BINS - 1)]));
  context.globalCompositeOperation = "lighter";
  const colours = ["#7d2f2b", "#2c6631", "#2a4c8c", "#262626"];
  counts.forEach((c, k) => {
    context.fillStyle = colours[k]!;
    c.forEach((n, i) => {
      const h = Math.min(Math.sqrt(n / peak), 1) * height;
      context.fillRect(2 * i, height - h, 2, h);
    });
  });
  context.globalCompositeOperation = "source-over";
  context.fillStyle = "rgba(255,255,255,0.45)";
  context.fillRect(Math.round((-STOPS_LOW / (STOPS_HIGH - STOPS_LOW)) * width), 0, 1, height);
}
