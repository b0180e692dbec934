// A layer's reflectance at normal incidence: by a metal's name, or by an index of refraction.
import { NumberBox } from "../controls/number";
import type { LayerInfo, LayerValues, RGB } from "../messages";
import * as model from "../model";

const SAME = 2e-3;
const MOST_IOR = 50;

/** ((n − 1)² + k²) / ((n + 1)² + k²). */
const reflectance = (n: number, k: number): number => ((n - 1) ** 2 + k * k) / ((n + 1) ** 2 + k * k);

function iorOf(color: RGB): number {
  const root = Math.sqrt(Math.min(Math.max((color[0] + color[1] + color[2]) / 3, 0), 1));
  return Math.min((1 + root) / Math.max(1 - root, 1e-9), MOST_IOR);
}

/** What the layer reflects at normal incidence now, linear RGB. */
function present(info: LayerInfo, values: LayerValues): RGB {
  const color = (values.values["color"] ?? [1, 1, 1]) as RGB;
  if (info.fresnel !== "complex") return color;
  const [eta, k] = [values.values["eta"] as RGB, values.values["k"] as RGB];
  return color.map((c, i) => c * reflectance(eta[i]!, k[i]!)) as RGB;
}

export function Fresnel({ path, info, values }: { path: string; info: LayerInfo; values: LayerValues }) {
  if (info.fresnel !== "color" && info.fresnel !== "complex") return null;
  const now = present(info, values);
  const metals = model.welcome.value?.metals ?? [];
  const known = metals.find((metal) => metal.reflectance.every((x, i) => Math.abs(x - now[i]!) < SAME));
  return (
    <>
      <div class="row" title="Gives the layer a metal's reflectance, from its measured index of refraction">
        <span class="label">Metal</span>
        <select
          aria-label="Metal"
          value={known?.name ?? ""}
          onChange={(event) => event.currentTarget.value && model.setMetal(path, event.currentTarget.value)}
        >
          <option value="">{known ? "—" : "choose …"}</option>
          {metals.map((metal) => (
            <option key={metal.name} value={metal.name}>
              {metal.name}
            </option>
          ))}
        </select>
      </div>
      {info.fresnel === "color" && (
        <div class="row" title="Index of refraction with the same reflectance at normal incidence: 1.5 is 4 %. Sets a grey colour.">
          <span class="label">IOR</span>
          <span />
          <NumberBox
            label="IOR"
            value={iorOf(now)}
            minimum={1}
            maximum={MOST_IOR}
            onChange={(next) => {
              const f = reflectance(next, 0);
              model.setValue(`${path}.color`, [f, f, f]);
            }}
          />
        </div>
      )}
    </>
  );
}
