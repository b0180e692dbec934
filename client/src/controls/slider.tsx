// A labelled slider over the soft limits, with a number box over the hard ones.
import { useEffect, useState } from "preact/hooks";
import { NumberBox, short } from "./number";

export interface SliderProps {
  label: string;
  value: number;
  initial: number;
  minimum: number;
  maximum: number;
  softMinimum: number;
  softMaximum: number;
  unit?: string;
  /** How the slider's travel maps to the value; "square" is value = travel². */
  scale?: "linear" | "logarithmic" | "square";
  tip?: string;
  onChange(value: number): void;
  onBegin?(): void;
  onEnd?(): void;
  onReset(): void;
}

const STEPS = 1000;

export function Slider(props: SliderProps) {
  const { label, value, minimum, maximum, softMinimum: low, softMaximum: high, unit, tip } = props;
  // While it is dragged the slider shows the hand's value, not the server's echo of it.
  const [held, setHeld] = useState<number | null>(null);
  const shown = held ?? value;
  useEffect(() => {
    if (held === null) return;
    const release = () => {
      setHeld(null);
      props.onEnd?.();
    };
    window.addEventListener("pointerup", release);
    window.addEventListener("pointercancel", release);
    return () => {
      window.removeEventListener("pointerup", release);
      window.removeEventListener("pointercancel", release);
    };
  }, [held === null]);

  // Ranges over many decades get equal room for each.
  const decades = low > 0 && (props.scale === "logarithmic" || (props.scale !== "square" && high / low >= 100));
  const bend = (x: number) => (decades ? Math.log(Math.max(x, low)) : props.scale === "square" ? Math.sqrt(Math.max(x, 0)) : x);
  const straight = (x: number) => (decades ? Math.exp(x) : props.scale === "square" ? x * x : x);
  const [start, end] = [bend(low), bend(high)];
  const toStep = (x: number) => (STEPS * (bend(x) - start)) / (end - start);
  const fromStep = (s: number) => Math.min(Math.max(straight(start + ((end - start) * s) / STEPS), low), high);

  const fraction = Math.min(Math.max(toStep(shown) / STEPS, 0), 1);
  const changed = Math.abs(value - props.initial) > 1e-9 * Math.max(Math.abs(value), 1);
  const range = `${short(minimum)} to ${short(maximum)}${unit ? ` ${unit}` : ""}`;
  const help = `${tip ? `${tip}\n` : ""}${label}: ${range}. Double-click to reset.`;
  return (
    <div class={changed ? "row changed" : "row"} title={help}>
      <span class="label" onDblClick={props.onReset}>
        {label}
      </span>
      <input
        type="range"
        min={0}
        max={STEPS}
        step="any"
        value={toStep(shown)}
        aria-label={label}
        aria-valuetext={`${short(shown)}${unit ? ` ${unit}` : ""}`}
        style={{ "--fraction": `${fraction * 100}%` }}
        onPointerDown={(event) => {
          if (event.ctrlKey || event.metaKey) {
            event.preventDefault();
            props.onReset();
            return;
          }
          props.onBegin?.();
          setHeld(shown);
        }}
        onInput={(event) => {
          const next = fromStep(Number(event.currentTarget.value));
          if (held !== null) setHeld(next);
          props.onChange(next);
        }}
        onKeyDown={(event) => {
          const step = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1 }[event.key];
          if (step === undefined) return;
          event.preventDefault();
          const by = step * (event.shiftKey ? 100 : 10);
          props.onChange(fromStep(Math.min(Math.max(toStep(value) + by, 0), STEPS)));
        }}
        onDblClick={props.onReset}
      />
      <NumberBox
        label={label}
        value={shown}
        minimum={minimum}
        maximum={maximum}
        unit={unit}
        onChange={props.onChange}
      />
    </div>
  );
}
