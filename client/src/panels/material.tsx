// The selected object: its look, and each layer with its parameters and curve.
import { useSignal } from "@preact/signals";
import { Slider } from "../controls/slider";
import type { LayerInfo, LayerValues } from "../messages";
import * as model from "../model";
import { AppearancePanel } from "./appearance";
import { ModelChooser } from "./chooser";
import { CurveEditor } from "./curve";
import { Fresnel } from "./fresnel";
import { Parameter } from "./parameter";

export function Material() {
  const object = model.selectedObject.value;
  if (!object) {
    return (
      <section class="panel material" aria-label="Material">
        <p class="empty">Click an object in the picture or in the list to edit its material.</p>
      </section>
    );
  }
  const values = model.materials.value[object.id];
  const warnings = model.warnings.value.filter((text) => text.includes(object.id));
  const percent = values ? values.albedo.map((x) => Math.round(x * 100)) : [];
  return (
    <section class="panel material" aria-label={`Material of ${object.id}`}>
      <h2>
        {object.id}
        {model.selected.value.length > 1 && <small>+{model.selected.value.length - 1} more</small>}
        <span class="spacer" />
        <button disabled={!values?.changed} title="Back to the scene's own material" onClick={() => model.reset(object.id)}>
          Reset
        </button>
      </h2>
      <AppearancePanel />
      {values && (
        <p class="albedo" title="Share of the light that is reflected under a uniform sky, by channel">
          Reflects <b>{new Set(percent).size === 1 ? `${percent[0]} %` : percent.map((p) => `${p} %`).join(" · ")}</b>
        </p>
      )}
      {values &&
        object.layers.map((info) => {
          const layer = values.layers[info.name];
          return layer && <Layer key={`${object.id}.${info.name}`} path={`${object.id}.${info.name}`} info={info} values={layer} count={object.layers.length} />;
        })}
      {/* Below everything, so that no control moves away from a hand that drags it. */}
      <div class="warnings" role="status">
        {warnings.map((text) => (
          <p key={text} class="warning">
            {text}
          </p>
        ))}
      </div>
    </section>
  );
}

function Layer({ path, info, values, count }: { path: string; info: LayerInfo; values: LayerValues; count: number }) {
  const open = useSignal(true);
  const data = model.curves.value;
  const curve = data && path === `${data.object}.${info.name}` ? data.layers.find((l) => l.layer === info.name) : undefined;
  const second = data && path === `${data.object}.${info.name}` ? data.second.find((l) => l.layer === info.name) : undefined;
  return (
    <section class={values.enabled ? "layer" : "layer off"} aria-label={`Layer ${info.name}`}>
      <h3>
        <button class="fold" aria-expanded={open.value} aria-label={`${open.value ? "Fold" : "Unfold"} ${info.name}`} onClick={() => (open.value = !open.value)}>
          {open.value ? "▾" : "▸"}
        </button>
        <span title={info.description}>{info.name}</span>
        <ModelChooser path={path} info={info} />
        <span class="spacer" />
        {count > 1 && (
          <button title="Only this layer; again for all" onClick={() => model.solo(path)}>
            Solo
          </button>
        )}
        <label class="switch" title={values.enabled ? "Switch the layer off" : "Switch the layer on"}>
          <input
            type="checkbox"
            role="switch"
            aria-label={`Layer ${info.name} on`}
            checked={values.enabled}
            onChange={(event) => model.setEnabled(path, event.currentTarget.checked)}
          />
          <i />
        </label>
      </h3>
      {open.value && (
        <div class="body">
          <Fresnel path={path} info={info} values={values} />
          {info.parameters.map((parameter) => (
            <Parameter
              key={`${info.model}.${parameter.name}`}
              path={`${path}.${parameter.name}`}
              info={parameter}
              fresnel={info.fresnel}
              value={values.values[parameter.name] ?? parameter.default}
              map={values.maps[parameter.name] ?? null}
            />
          ))}
          <Slider
            label="Weight"
            value={values.weight}
            initial={info.weight}
            minimum={0}
            maximum={100}
            softMinimum={0}
            softMaximum={2}
            tip="Scales the whole layer"
            onChange={(next) => model.setWeight(path, next)}
            onBegin={model.beginDrag}
            onEnd={model.endDrag}
            onReset={() => model.setWeight(path, info.weight)}
          />
          {curve && (
            <CurveEditor
              key={info.model}
              name={info.name}
              coordinate={info.coordinate}
              maximum={info.coordinate_maximum}
              data={curve}
              curve={values.curve}
              set={(next) => model.setCurve(path, next)}
            />
          )}
          {second && (
            <CurveEditor
              key={`${info.model} second`}
              name={`${info.name}, second curve`}
              coordinate={info.second_coordinate}
              maximum={90}
              data={second}
              curve={values.second_curve}
              set={(next) => model.setSecondCurve(path, next)}
            />
          )}
          <ViewingCurve path={path} info={info} values={values} />
        </div>
      )}
    </section>
  );
}

/** A freehand factor on the angle from which the layer is seen. */
function ViewingCurve({ path, info, values }: { path: string; info: LayerInfo; values: LayerValues }) {
  const open = useSignal(false);
  const data = model.curves.value;
  const curve = data && path === `${data.object}.${info.name}` ? data.outgoing.find((l) => l.layer === info.name) : undefined;
  if (!curve) return null;
  return (
    <div class="viewing">
      <button class="fold" aria-expanded={open.value} title="How strong the layer is by the angle from which it is seen" onClick={() => (open.value = !open.value)}>
        {open.value ? "▾" : "▸"} Viewing angle
        {values.outgoing_curve && <span class="dot" aria-label="edited" />}
      </button>
      {open.value && (
        <CurveEditor
          name={`${info.name} over the viewing angle`}
          coordinate="theta_o"
          maximum={90}
          data={curve}
          curve={values.outgoing_curve}
          set={(next) => model.setOutgoingCurve(path, next)}
        />
      )}
    </div>
  );
}
