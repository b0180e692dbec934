// A colour: a swatch that opens a picker with sRGB and linear numbers side by side.
import { useEffect, useRef, useState } from "preact/hooks";
import { fromHex, fromHsv, hex, toHsv, toLinear, toSrgb } from "../colour";
import type { RGB } from "../messages";
import { welcome } from "../model";
import { NumberBox, short } from "./number";

export interface ColourProps {
  label: string;
  value: RGB;
  initial: RGB;
  minimum: number;
  maximum: number;
  tip?: string;
  metals: boolean;
  onChange(value: RGB): void;
  onBegin(): void;
  onEnd(): void;
  onReset(): void;
}

export const close = (a: RGB, b: RGB): boolean => a.every((x, i) => Math.abs(x - (b[i] ?? 0)) < 1e-9);

export function Colour(props: ColourProps) {
  const { label, value, tip } = props;
  const [open, setOpen] = useState(false);
  const root = useRef<HTMLDivElement>(null);
  useEffect(() => {
    if (!open) return;
    const outside = (event: PointerEvent) => {
      if (!root.current?.contains(event.target as Node)) setOpen(false);
    };
    window.addEventListener("pointerdown", outside);
    return () => window.removeEventListener("pointerdown", outside);
  }, [open]);
  const changed = !close(value, props.initial);
  return (
    <div
      ref={root}
      class={changed ? "row changed" : "row"}
      title={`${tip ? `${tip}\n` : ""}${label}: linear RGB, ${short(props.minimum)} to ${short(props.maximum)}. Double-click the name to reset.`}
      onKeyDown={(event) => {
        if (event.key === "Escape" && open) {
          setOpen(false);
          event.stopPropagation();
        }
      }}
    >
      <span class="label" onDblClick={props.onReset}>
        {label}
      </span>
      <button
        class="swatch"
        aria-label={`${label}, ${hex(value)}`}
        aria-expanded={open}
        style={{ background: hex(value) }}
        onClick={() => setOpen(!open)}
      />
      <input
        class="number hex"
        aria-label={`${label} as sRGB hex`}
        spellcheck={false}
        value={hex(value)}
        onFocus={(event) => event.currentTarget.select()}
        onChange={(event) => {
          const colour = fromHex(event.currentTarget.value);
          if (colour) props.onChange(colour);
          else event.currentTarget.value = hex(value);
        }}
      />
      {open && <Picker {...props} />}
    </div>
  );
}

function Picker({ label, value, minimum, maximum, metals, onChange, onBegin, onEnd }: ColourProps) {
  // Hue and saturation live here, so that they survive black and grey.
  const [hsv, setHsv] = useState<RGB>(() => toHsv(toSrgb(value)));
  const own = useRef<RGB>(value);
  useEffect(() => {
    if (!close(own.current, value) && !dragging.current) setHsv(toHsv(toSrgb(value)));
  }, [value]);
  const dragging = useRef(false);
  const clamp = (x: number) => Math.min(Math.max(x, minimum), maximum);
  const emit = (linear: RGB) => {
    const colour: RGB = [clamp(linear[0]), clamp(linear[1]), clamp(linear[2])];
    own.current = colour;
    onChange(colour);
  };
  const fromPad = (next: RGB) => {
    setHsv(next);
    emit(toLinear(fromHsv(next)));
  };
  const drag = (apply: (x: number, y: number) => void) => (event: PointerEvent) => {
    const target = event.currentTarget as HTMLElement;
    const box = target.getBoundingClientRect();
    const at = (e: PointerEvent) =>
      apply(
        Math.min(Math.max((e.clientX - box.left) / box.width, 0), 1),
        Math.min(Math.max((e.clientY - box.top) / box.height, 0), 1),
      );
    onBegin();
    dragging.current = true;
    at(event);
    const stop = () => {
      dragging.current = false;
      window.removeEventListener("pointermove", at);
      window.removeEventListener("pointerup", stop);
      onEnd();
    };
    window.addEventListener("pointermove", at);
    window.addEventListener("pointerup", stop);
    event.preventDefault();
  };
  const [h, s, v] = hsv;
  const srgb = toSrgb(value);
  const step = (event: KeyboardEvent, apply: (dx: number, dy: number) => void) => {
    const by = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (!by) return;
    apply((by[0] ?? 0) * 0.01, (by[1] ?? 0) * 0.01);
    event.preventDefault();
  };
  const unit = (x: number) => Math.min(Math.max(x, 0), 1);
  return (
    <div class="picker" role="group" aria-label={`${label} picker`}>
      <div
        class="pad"
        role="slider"
        tabIndex={0}
        aria-label="Saturation and value"
        aria-valuetext={`saturation ${Math.round(s * 100)} %, value ${Math.round(v * 100)} %`}
        aria-valuenow={Math.round(v * 100)}
        style={{ "--hue": `hsl(${h} 100% 50%)` }}
        onPointerDown={drag((x, y) => fromPad([h, x, 1 - y]))}
        onKeyDown={(event) => step(event, (dx, dy) => fromPad([h, unit(s + dx), unit(v + dy)]))}
      >
        <i style={{ left: `${s * 100}%`, top: `${(1 - v) * 100}%`, background: hex(value) }} />
      </div>
      <div
        class="hue"
        role="slider"
        tabIndex={0}
        aria-label="Hue"
        aria-valuenow={Math.round(h)}
        aria-valuemin={0}
        aria-valuemax={360}
        onPointerDown={drag((x) => fromPad([x * 359.99, s, v]))}
        onKeyDown={(event) => step(event, (dx) => fromPad([(h + dx * 300 + 360) % 360, s, v]))}
      >
        <i style={{ left: `${h / 3.6}%` }} />
      </div>
      <table>
        <thead>
          <tr>
            <th />
            <th scope="col">R</th>
            <th scope="col">G</th>
            <th scope="col">B</th>
          </tr>
        </thead>
        <tbody>
          <tr>
            <th scope="row">sRGB</th>
            {srgb.map((x, i) => (
              <td key={i}>
                <NumberBox
                  label={`sRGB ${"RGB"[i]}`}
                  value={Math.round(x * 255)}
                  minimum={0}
                  maximum={255}
                  onChange={(next) => {
                    const c = [...srgb] as RGB;
                    c[i] = next / 255;
                    emit(toLinear(c));
                  }}
                />
              </td>
            ))}
          </tr>
          <tr>
            <th scope="row">Linear</th>
            {value.map((x, i) => (
              <td key={i}>
                <NumberBox
                  label={`Linear ${"RGB"[i]}`}
                  value={x}
                  minimum={minimum}
                  maximum={maximum}
                  onChange={(next) => {
                    const c = [...value] as RGB;
                    c[i] = next;
                    emit(c);
                  }}
                />
              </td>
            ))}
          </tr>
        </tbody>
      </table>
      {metals && (
        <div class="metals" role="group" aria-label="Metals">
          {(welcome.value?.metals ?? []).map(({ name, reflectance }) => (
            <button
              key={name}
              class="metal"
              title={`${name}: reflectance at normal incidence`}
              aria-label={name}
              style={{ background: hex(reflectance) }}
              onClick={() => emit(reflectance)}
            />
          ))}
        </div>
      )}
    </div>
  );
}

