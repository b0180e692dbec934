// A number box: typed values are checked against the hard limits when they are entered.
import { useRef, useState } from "preact/hooks";

export interface NumberBoxProps {
  value: number;
  minimum: number;
  maximum: number;
  label: string;
  unit?: string;
  onChange(value: number): void;
}

/** Four significant digits, three of small numbers: as many as a box holds, without trailing zeros. */
export function short(value: number): string {
  if (value === 0) return "0";
  const size = Math.abs(value);
  return size >= 1e5 || size < 1e-3 ? value.toExponential(2) : String(Number(value.toPrecision(size < 0.1 ? 3 : 4)));
}

export function NumberBox({ value, minimum, maximum, label, unit, onChange }: NumberBoxProps) {
  const [text, setText] = useState<string | null>(null);
  const input = useRef<HTMLInputElement>(null);

  const commit = () => {
    if (text === null) return;
    const number = Number(text.replace(",", "."));
    setText(null);
    if (text.trim() !== "" && Number.isFinite(number)) {
      onChange(Math.min(Math.max(number, minimum), maximum));
    }
  };
  const nudge = (sign: number, event: KeyboardEvent) => {
    const fine = event.shiftKey ? 10 : event.altKey ? 0.1 : 1;
    const step = 10 ** (Math.floor(Math.log10(Math.max(Math.abs(value), 0.01))) - 1);
    onChange(Math.min(Math.max(value + sign * step * fine, minimum), maximum));
    event.preventDefault();
  };
  return (
    <input
      ref={input}
      class="number"
      type="text"
      inputMode="decimal"
      spellcheck={false}
      aria-label={unit ? `${label} (${unit})` : label}
      title={`${label}: ${short(minimum)} to ${short(maximum)}${unit ? ` ${unit}` : ""}`}
      value={text ?? short(value)}
      onInput={(event) => setText(event.currentTarget.value)}
      onFocus={(event) => event.currentTarget.select()}
      onBlur={commit}
      onKeyDown={(event) => {
        if (event.key === "Enter") {
          commit();
          input.current?.select();
        } else if (event.key === "Escape") setText(null);
        else if (event.key === "ArrowUp") nudge(1, event);
        else if (event.key === "ArrowDown") nudge(-1, event);
      }}
    />
  );
}
