// The lights: which shine, how much and in what colour; and where they stand and how they are turned.
import { useEffect, useRef } from "preact/hooks";
import { Colour } from "../controls/colour";
import { Slider } from "../controls/slider";
import { FileBox, VectorBoxes } from "../controls/vector";
import type { LightData, ParameterInfo } from "../messages";
import * as model from "../model";
import * as placing from "../placing";
import type { Place } from "../viewer/camera";
import { label, Parameter } from "./parameter";

/** Stops to either side that the slider spans, and the fewest that the number box takes. */
const SPAN = 6;
const DARKEST = -20;

export function Lights() {
  const data = model.lights.value;
  const solo = data?.items.some((light) => light.solo) ?? false;
  return (
    <section class="panel lights" aria-label="Lights">
      {data?.text && (
        <p class="caption" role="status">
          {data.text}
        </p>
      )}
      {data?.fixed && data.items.length > 0 && <p class="caption">Lights cannot be moved or turned here: {data.fixed}.</p>}
      {data?.items.map((light) => <Light key={light.path} light={light} maximum={data.maximum} solo={solo} />)}
      {data?.items.length === 0 && <p class="empty">This bundle does not say which lights its scene has; bake it again to mix them.</p>}
    </section>
  );
}

function Light({ light, maximum, solo }: { light: LightData; maximum: number; solo: boolean }) {
  const set = (parameter: string) => (value: number | string | [number, number, number]) => model.setValue(`${light.path}.${parameter}`, value);
  const reset = (parameter: string) => () => model.reset(`${light.path}.${parameter}`);
  const shines = light.on && (light.solo || !solo);
  const members = light.members.length > 1 ? light.members.join(", ") : "";
  const chosen = placing.chosen.value === light.path;
  const section = useRef<HTMLElement>(null);
  useEffect(() => {
    if (chosen) section.current?.scrollIntoView({ block: "nearest" });
  }, [chosen]);
  const drag = { onBegin: model.beginDrag, onEnd: model.endDrag };
  return (
    <section ref={section} class={`layer${shines ? "" : " off"}${chosen ? " chosen" : ""}`} aria-label={`Light ${light.name}`}>
      <h3>
        <span title={members}>{light.name}</span>
        <small>{members}</small>
        <span class="spacer" />
        <button disabled={!light.changed} title="Back to the scene's own" onClick={() => model.reset(light.path)}>
          Reset
        </button>
        <button aria-pressed={light.solo} title="Only lights that are solo shine" onClick={() => set("solo")(light.solo ? "off" : "on")}>
          Solo
        </button>
        <Switch light={light} />
      </h3>
      <div class="body">
        <Slider
          label="Intensity"
          value={light.intensity}
          initial={1}
          minimum={0}
          maximum={maximum}
          softMinimum={0}
          softMaximum={4}
          scale="square"
          unit="×"
          tip="What the light sends, as a multiple of the scene's"
          onChange={set("intensity")}
          onReset={reset("intensity")}
          {...drag}
        />
        <Slider
          label="Stops"
          value={light.intensity > 0 ? Math.max(Math.log2(light.intensity), DARKEST) : DARKEST}
          initial={0}
          minimum={DARKEST}
          maximum={Math.log2(maximum)}
          softMinimum={-SPAN}
          softMaximum={SPAN}
          unit="stops"
          tip="The same intensity in photographic stops: one more is twice the light"
          onChange={(stops) => set("intensity")(2 ** stops)}
          onReset={reset("intensity")}
          {...drag}
        />
        <Colour
          label="Tint"
          value={light.tint}
          initial={[1, 1, 1]}
          minimum={0}
          maximum={1}
          tip="Multiplies the light's own colour"
          metals={false}
          onChange={set("tint")}
          onReset={reset("tint")}
          {...drag}
        />
        {light.parameters.map((info) => (
          <Placement key={info.name} light={light} info={info} />
        ))}
      </div>
    </section>
  );
}

/** One of the parameters that lights of its kind have. */
function Placement({ light, info }: { light: LightData; info: ParameterInfo }) {
  const path = `${light.path}.${info.name}`;
  const now = light.values[info.name] ?? info.default;
  const onReset = () => model.reset(path);
  if (info.kind === "vector" || info.kind === "direction") {
    return (
      <VectorBoxes
        label={label(info.name)}
        value={placing.placeOf(light, info.name) ?? (now as Place)}
        initial={info.default as Place}
        minimum={info.minimum}
        maximum={info.maximum}
        tip={info.description}
        onChange={(value) => model.setValue(path, value)}
        onReset={onReset}
      />
    );
  }
  if (info.kind === "file") {
    return (
      <FileBox
        label={label(info.name)}
        value={now as string}
        tip={info.description}
        onChange={(value) => (value ? model.setValue(path, value) : onReset())}
        onReset={onReset}
      />
    );
  }
  return <Parameter path={path} info={info} value={now} fresnel="" />;
}

function Switch({ light }: { light: LightData }) {
  return (
    <label class="switch" title={light.on ? "Switch the light off" : "Switch the light on"}>
      <input
        type="checkbox"
        role="switch"
        aria-label={`Light ${light.name} on`}
        checked={light.on}
        onChange={(event) => model.setValue(`${light.path}.on`, event.currentTarget.checked ? "on" : "off")}
      />
      <i />
    </label>
  );
}

/** The lights among what the scene has: a click opens their panel. */
export function LightList() {
  const items = model.lights.value?.items ?? [];
  if (items.length === 0) return null;
  return (
    <section class="panel light-list" aria-label="Lights of the scene">
      <h2>
        Lights <small>{items.length}</small>
      </h2>
      <ul>
        {items.map((light) => (
          <li key={light.path}>
            <button class="object" title={light.members.join(", ")} onClick={() => placing.choose(light.path)}>
              <span class="name">{light.name}</span>
              {light.changed && <span class="dot" title="Not as in the scene" aria-label="changed" />}
              {!light.on && <span class="note">off</span>}
              {light.solo && <span class="note">solo</span>}
            </button>
          </li>
        ))}
      </ul>
    </section>
  );
}
