// One parameter of a layer: slider, colour or choice, built from its description.
import { Colour } from "../controls/colour";
import { Slider } from "../controls/slider";
import type { LayerInfo, MapData, ParameterInfo, RGB, Value } from "../messages";
import * as model from "../model";
import { Mapped } from "./mapped";

/** "specular_ior" as "Specular ior", with the usual capitals. */
export function label(name: string): string {
  const words = name.replace(/_/g, " ").replace(/\bior\b/, "IOR");
  return words.charAt(0).toUpperCase() + words.slice(1);
}

interface Props {
  path: string;
  info: ParameterInfo;
  value: Value;
  fresnel: LayerInfo["fresnel"];
  /** The picture in its place; undefined where it can have none. */
  map?: MapData | null;
}

export function Parameter(props: Props) {
  const { path, info, map } = props;
  const pictured = map !== undefined && (info.kind === "colour" || info.kind === "scalar");
  return pictured ? (
    <Mapped path={path} name={label(info.name)} map={map} colour={info.kind === "colour"}>
      <Plain {...props} />
    </Mapped>
  ) : (
    <Plain {...props} />
  );
}

function Plain({ path, info, value, fresnel }: Props) {
  const reset = () => model.reset(path);
  if (info.kind === "colour") {
    return (
      <Colour
        label={label(info.name)}
        value={value as RGB}
        initial={info.default as RGB}
        minimum={info.minimum}
        maximum={info.maximum}
        tip={info.description}
        metals={fresnel === "color" && info.name === "color"}
        onChange={(next) => model.setValue(path, next)}
        onBegin={model.beginDrag}
        onEnd={model.endDrag}
        onReset={reset}
      />
    );
  }
  if (info.kind === "choice") {
    return (
      <div class={value === info.default ? "row" : "row changed"} title={info.description}>
        <span class="label" onDblClick={reset}>
          {label(info.name)}
        </span>
        <select
          aria-label={label(info.name)}
          value={value as string}
          onChange={(event) => model.setValue(path, event.currentTarget.value)}
        >
          {info.choices.map((choice) => (
            <option key={choice}>{choice}</option>
          ))}
        </select>
      </div>
    );
  }
  return (
    <Slider
      label={label(info.name)}
      value={value as number}
      initial={info.default as number}
      minimum={info.minimum}
      maximum={info.maximum}
      softMinimum={info.soft_minimum}
      softMaximum={info.soft_maximum}
      unit={info.unit}
      scale={info.scale}
      tip={info.description}
      onChange={(next) => model.setValue(path, next)}
      onBegin={model.beginDrag}
      onEnd={model.endDrag}
      onReset={reset}
    />
  );
}
