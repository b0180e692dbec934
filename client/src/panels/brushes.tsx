// The brushes: which one is in hand, and how it is held.
import { Colour } from "../controls/colour";
import { Slider } from "../controls/slider";
import * as model from "../model";
import * as painting from "../painting";
import type { BrushData, RGB } from "../messages";

const RED: RGB = [0.527, 0.051, 0.027];

const nameOf = (item: BrushData): string => {
  const words = item.label || item.name.replaceAll("-", " ").replace("color", "colour");
  return words.charAt(0).toUpperCase() + words.slice(1);
};

export function Brushes() {
  const known = painting.known.value;
  const item = painting.inHand.value;
  const object = known?.object ?? "";
  return (
    <section class="panel brushes" aria-label="Brushes">
      <h2>Paint {object && <small>{object}</small>}</h2>
      <div class="brush-list" role="radiogroup" aria-label="Brush">
        {(known?.items ?? []).map((choice) => (
          <button
            key={choice.name}
            role="radio"
            aria-checked={painting.brush.value === choice.name}
            disabled={choice.reason !== ""}
            title={choice.reason || nameOf(choice)}
            onClick={() => (painting.brush.value = painting.brush.value === choice.name ? "" : choice.name)}
          >
            {nameOf(choice)}
          </button>
        ))}
      </div>
      {item ? <Held item={item} /> : <p class="empty">Choose a brush, and draw on the picture.</p>}
      <p class="caption">
        Shift draws a straight line, [ and ] change the size{item?.name === "clone" && ", Alt-click sets where to copy from"}.
        What the eye meets first shows each stroke; reflected on, an object counts by the mean of its paint.
      </p>
    </section>
  );
}

function Held({ item }: { item: BrushData }) {
  const chosen = model.selected.value;
  const painted = painting.known.value?.painted ?? [];
  return (
    <>
      {item.colour && (
        <Colour
          label="Brush colour"
          value={painting.colour.value}
          initial={RED}
          minimum={0}
          maximum={1}
          metals={false}
          onChange={(next) => (painting.colour.value = next)}
          onBegin={() => undefined}
          onEnd={() => undefined}
          onReset={() => (painting.colour.value = RED)}
        />
      )}
      <Slider
        label="Size"
        value={painting.size.value}
        initial={25}
        minimum={1}
        maximum={4096}
        softMinimum={1}
        softMaximum={400}
        scale="logarithmic"
        unit="px"
        tip="The brush's radius"
        onChange={(next) => (painting.size.value = next)}
        onReset={() => (painting.size.value = 25)}
      />
      <Slider
        label="Strength"
        value={painting.strength.value}
        initial={1}
        minimum={0}
        maximum={1}
        softMinimum={0}
        softMaximum={1}
        tip="The largest share of the effect"
        onChange={(next) => (painting.strength.value = next)}
        onReset={() => (painting.strength.value = 1)}
      />
      <Slider
        label="Falloff"
        value={painting.falloff.value}
        initial={0.6}
        minimum={0}
        maximum={10}
        softMinimum={0}
        softMaximum={1}
        tip="Of the Gaussian, as a share of the radius; 0 is a hard edge"
        onChange={(next) => (painting.falloff.value = next)}
        onReset={() => (painting.falloff.value = 0.6)}
      />
      {item.maximum > item.minimum && (
        <Slider
          label="Amount"
          value={painting.amountOf(item)}
          initial={item.amount}
          minimum={item.minimum}
          maximum={item.maximum}
          softMinimum={item.minimum}
          softMaximum={item.maximum}
          tip={item.meaning}
          onChange={(next) => (painting.amounts.value = { ...painting.amounts.value, [item.name]: next })}
          onReset={() => (painting.amounts.value = { ...painting.amounts.value, [item.name]: item.amount })}
        />
      )}
      {item.layers.length > 1 && !["clone", "eraser"].includes(item.name) && (
        <label class="row">
          <span class="label">Layer</span>
          <select
            value={painting.settings().layer || item.layers[0]}
            onChange={(e) => (painting.layers.value = { ...painting.layers.value, [item.name]: e.currentTarget.value })}
          >
            {item.layers.map((layer) => (
              <option key={layer}>{layer}</option>
            ))}
          </select>
        </label>
      )}
      <div class="brush-scope">
        <label title="Else a stroke stays on the object that it first meets">
          <input type="checkbox" checked={painting.every.value} onChange={(e) => (painting.every.value = e.currentTarget.checked)} />
          Across all objects
        </label>
        {item.name !== "clone" && (
          <button disabled={chosen.length === 0 || (item.name === "eraser" && !chosen.some((id) => painted.includes(id)))} onClick={painting.whole}>
            {item.name === "eraser" ? "Erase all of the object" : "All of the object"}
          </button>
        )}
      </div>
    </>
  );
}
