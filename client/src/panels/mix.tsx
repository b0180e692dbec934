// Every object's main parameters at once.
import * as model from "../model";
import { Parameter } from "./parameter";
import type { LayerInfo, ParameterInfo } from "../messages";

const MAIN = /color|colour|rough|exponent|alpha|width|ratio/i;

const mainOf = (layer: LayerInfo): ParameterInfo[] => layer.parameters.filter((p) => MAIN.test(p.name)).slice(0, 2);

export function Mix() {
  const items = model.objects.value.filter((item) => item.editable);
  return (
    <section class="panel mix" aria-label="Mix">
      {items.map((object) => {
        const values = model.materials.value[object.id];
        if (!values) return null;
        return (
          <section
            key={object.id}
            class={model.selected.value.includes(object.id) ? "channel chosen" : "channel"}
            aria-label={object.id}
            onMouseEnter={() => (model.hovered.value = object.id)}
            onMouseLeave={() => (model.hovered.value = "")}
          >
            <h3>
              <button class="link" onClick={() => model.select([object.id])}>
                {object.id}
              </button>
              <span class="spacer" />
              <button disabled={!values.changed} onClick={() => model.reset(object.id)}>
                Reset
              </button>
            </h3>
            {object.layers.map((layer) => {
              const own = values.layers[layer.name];
              return (
                own && (
                  <div key={layer.name} class={own.enabled ? "strip" : "strip off"}>
                    <span class="strip-name" title={layer.model}>
                      {layer.name}
                    </span>
                    <div>
                      {mainOf(layer).map((parameter) => (
                        <Parameter
                          key={parameter.name}
                          path={`${object.id}.${layer.name}.${parameter.name}`}
                          info={parameter}
                          fresnel={layer.fresnel}
                          value={own.values[parameter.name] ?? parameter.default}
                        />
                      ))}
                    </div>
                  </div>
                )
              );
            })}
          </section>
        );
      })}
    </section>
  );
}
