// Kept looks, the path-traced reference, and how the two sides are shown.
import { useSignal } from "@preact/signals";
import * as model from "../model";
import { handles } from "../viewer/view";

const MODES: [model.Comparison, string, string][] = [
  ["off", "Edit", "Only the edited picture"],
  ["wipe", "Wipe", "Left of the line the edited picture, right of it the other (W)"],
  ["other", "Other", "Only the other picture (hold B)"],
  ["difference", "Error", "Relative error as colour"],
];

const THUMBNAIL = 120;

/** Keep the look that the first shown view has now. */
export function keepLook(): void {
  const view = model.shownViews.value[0];
  const thumbnail = view && handles.get(view)?.picture(THUMBNAIL);
  if (!view || !thumbnail) return;
  model.takeSnapshot(`Look ${model.snapshots.value.length + 1}`, view, thumbnail.toDataURL("image/jpeg", 0.85));
}

/** Path-trace the first shown view, or a part of it. */
function trace(part: "whole" | "rectangle" | "visible", spp: number): void {
  const view = (part === "rectangle" && model.crop.value?.view) || (model.shownViews.value[0] ?? "");
  const visible = handles.get(view)?.visible() ?? null;
  const crop = part === "whole" ? null : part === "rectangle" ? (model.crop.value?.pixels ?? null) : visible;
  model.pathTrace(view, spp, crop);
  model.crop.value = null;
  if (part === "rectangle") model.pickingCrop.value = false;
}

export function Compare() {
  const spp = useSignal(64);
  const part = useSignal<"whole" | "rectangle" | "visible">("whole");
  const reference = model.reference.value;
  const unavailable = model.welcome.value?.path_tracer ?? "";
  const running = reference?.status === "running";
  const something = model.comparedWith.value !== "" || (reference?.spp ?? 0) > 0;
  const figure = (name: string, digits: number, unit = "") => {
    const value = reference?.metrics[name];
    return value === undefined ? "–" : `${value.toFixed(digits)}${unit}`;
  };
  return (
    <section class="panel compare" aria-label="Compare">
      <h2>
        Compare
        <span class="spacer" />
        <button title="Keep this look (K)" onClick={keepLook}>
          Keep look
        </button>
      </h2>
      <div class="looks">
        {model.snapshots.value.map((item) => (
          <div key={item.id} class="look">
            <button class="thumbnail" title={`Edit on from ${item.label}`} aria-label={`Restore ${item.label}`} onClick={() => model.restoreSnapshot(item.id)}>
              <img src={item.thumbnail} alt="" />
            </button>
            <span class="name">{item.label}</span>
            <button class="small" title="Wipe between this and the edited picture" onClick={() => model.compareSnapshot(item)}>
              A/B
            </button>
            <button class="small" aria-label={`Delete ${item.label}`} title="Delete" onClick={() => model.forgetSnapshot(item.id)}>
              ×
            </button>
          </div>
        ))}
        {model.snapshots.value.length === 0 && <p class="empty">Kept looks appear here.</p>}
      </div>
      <div class="reference">
        <select
          aria-label="Part of the picture for the reference"
          title="What is path-traced: the whole picture, a rectangle that you draw in it, or what the window shows"
          value={part.value}
          disabled={!!unavailable}
          onChange={(e) => {
            const next = e.currentTarget.value as "whole" | "rectangle" | "visible";
            part.value = next;
            model.crop.value = null;
            model.pickingCrop.value = next === "rectangle";
            if (next === "rectangle") model.say("info", "Drag a rectangle in the picture.");
          }}
        >
          <option value="whole">Whole</option>
          <option value="rectangle">Rectangle</option>
          <option value="visible">In view</option>
        </select>
        <select aria-label="Samples per pixel of the reference" value={spp.value} disabled={!!unavailable} onChange={(e) => (spp.value = Number(e.currentTarget.value))}>
          {[16, 64, 256, 1024, 4096].map((n) => (
            <option key={n} value={n}>
              {n} spp
            </option>
          ))}
        </select>
        {running ? (
          <button class="wide" onClick={model.cancelPathTrace}>
            Stop
          </button>
        ) : (
          <button
            class="wide"
            disabled={!!unavailable || (part.value === "rectangle" && !model.crop.value)}
            title={unavailable || "Path-trace the present materials in the background"}
            onClick={() => trace(part.value, spp.value)}
          >
            Path-trace
          </button>
        )}
      </div>
      {unavailable && <p class="empty">{unavailable}</p>}
      {reference && reference.status !== "none" && (
        <>
          <progress max={1} value={reference.fraction} aria-label="Reference" />
          <p class="figures">
            {reference.spp} spp
            {reference.crop && ` · ${reference.crop[2]} × ${reference.crop[3]} pixels`}
            {reference.stale && <em title="The materials have changed since"> · of earlier edits</em>}
            {reference.text && ` · ${reference.text}`}
          </p>
          {reference.status === "done" && (
            <dl>
              <dt title="Relative error of linear light, noise taken out">Error</dt>
              <dd>{figure("rel_rmse_beyond_noise", 4)}</dd>
              <dt title="Share of the error that is the reference's noise">Noise</dt>
              <dd>{figure("noise", 4)}</dd>
              <dt>FLIP</dt>
              <dd>{figure("flip", 4)}</dd>
              <dt>PSNR</dt>
              <dd>{figure("psnr", 1, " dB")}</dd>
            </dl>
          )}
        </>
      )}
      <div class="modes" role="radiogroup" aria-label="What the picture shows">
        {MODES.map(([mode, name, tip]) => (
          <button
            key={mode}
            role="radio"
            aria-checked={model.comparison.value === mode}
            disabled={mode !== "off" && !something}
            title={tip}
            onClick={() => (model.comparison.value = mode)}
          >
            {name}
          </button>
        ))}
      </div>
      {model.comparison.value === "wipe" && (
        <input
          type="range"
          min={0}
          max={1}
          step={0.005}
          aria-label="Place of the wipe"
          value={model.wipe.value}
          style={{ "--fraction": `${model.wipe.value * 100}%` }}
          onInput={(event) => (model.wipe.value = Number(event.currentTarget.value))}
        />
      )}
    </section>
  );
}
