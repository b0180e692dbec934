// Three coordinates as number boxes, and the path of a file as a text box.
import { useState } from "preact/hooks";
import type { Place } from "../viewer/camera";
import { NumberBox } from "./number";

const AXES = ["x", "y", "z"];

export interface VectorProps {
  label: string;
  value: Place;
  initial: Place;
  minimum: number;
  maximum: number;
  tip: string;
  onChange(value: Place): void;
  onReset(): void;
}

export function VectorBoxes({ label, value, initial, minimum, maximum, tip, onChange, onReset }: VectorProps) {
  const changed = value.some((number, k) => Math.abs(number - (initial[k] ?? 0)) > 1e-9 * Math.max(Math.abs(number), 1));
  return (
    <div class={changed ? "row vector changed" : "row vector"} title={`${tip}. Double-click to reset.`}>
      <span class="label" onDblClick={onReset}>
        {label}
      </span>
      {AXES.map((axis, k) => (
        <NumberBox
          key={axis}
          label={`${label} ${axis}`}
          value={value[k] ?? 0}
          minimum={minimum}
          maximum={maximum}
          onChange={(number) => onChange(value.map((old, j) => (j === k ? number : old)) as Place)}
        />
      ))}
    </div>
  );
}

export interface FileProps {
  label: string;
  value: string;
  tip: string;
  onChange(value: string): void;
  onReset(): void;
}

export function FileBox({ label, value, tip, onChange, onReset }: FileProps) {
  const [text, setText] = useState<string | null>(null);
  const commit = () => {
    if (text !== null && text.trim() !== value) onChange(text.trim());
    setText(null);
  };
  return (
    <div class={value ? "row file changed" : "row file"} title={`${tip}\n${value || "the scene's own"}`}>
      <span class="label" onDblClick={onReset}>
        {label}
      </span>
      <input
        type="text"
        spellcheck={false}
        aria-label={label}
        placeholder="path of a picture beside the server"
        value={text ?? value}
        onInput={(event) => setText(event.currentTarget.value)}
        onBlur={commit}
        onKeyDown={(event) => {
          if (event.key === "Enter") commit();
          else if (event.key === "Escape") setText(null);
        }}
      />
    </div>
  );
}
