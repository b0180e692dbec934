// The reflectance model of a layer: another one traces the selection anew.
import type { LayerInfo } from "../messages";
import * as model from "../model";

export function ModelChooser({ path, info }: { path: string; info: LayerInfo }) {
  const { models = [], models_fixed: fixed = "" } = model.welcome.value ?? {};
  const others = models.filter((item) => item.name !== info.own_model);
  const help = `${info.description}\n${fixed || "Another model traces the object's light anew; what can carries over."}`;
  return (
    <select
      class="model"
      aria-label={`Model of ${info.name}`}
      title={help}
      disabled={!!fixed}
      value={info.model}
      onChange={(event) => model.setModel(path, event.currentTarget.value)}
    >
      <option value={info.own_model}>{info.own_model}</option>
      {others.map((item) => (
        <option key={item.name} value={item.name} title={item.description}>
          {item.name}
        </option>
      ))}
    </select>
  );
}
