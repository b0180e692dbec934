// The brush: how it is held, and the strokes that the pen draws with it.
import { computed, signal } from "@preact/signals";
import type { Brushes, BrushData, BrushSettings, RGB } from "./messages";
import * as model from "./model";

export type PenPoint = [number, number, number];

const COLOUR: RGB = [0.527, 0.051, 0.027];
const LARGEST = 400;

/** The brush in hand, "" for none. */
export const brush = signal("");
export const size = signal(25);
export const strength = signal(1);
export const falloff = signal(0.6);
export const colour = signal<RGB>(COLOUR);
/** Amounts and layers that were chosen, by brush. */
export const amounts = signal<Record<string, number>>({});
export const layers = signal<Record<string, string>>({});
export const every = signal(false);
/** Where the clone stamp copies from, in a view's pixels. */
export const source = signal<[number, number] | null>(null);

export const known = computed<Brushes | null>(() => model.brushes.value);
export const inHand = computed<BrushData | null>(
  () => known.value?.items.find((item) => item.name === brush.value) ?? null,
);
/** Whether the pen paints, and does not move the picture. */
export const active = computed(() => model.tab.value === "paint" && brush.value !== "");

export const amountOf = (item: BrushData): number => amounts.value[item.name] ?? item.amount;

/** Larger or smaller by a step. */
export function resize(larger: boolean): void {
  const next = size.value * (larger ? 1.2 : 1 / 1.2);
  size.value = Math.min(Math.max(next, 1), LARGEST);
}

export function settings(): BrushSettings {
  const item = inHand.value;
  const layer = layers.value[brush.value] ?? "";
  return {
    brush: brush.value,
    size: size.value,
    strength: strength.value,
    falloff: falloff.value,
    color: colour.value,
    amount: item ? amountOf(item) : 0,
    layer: item?.layers.includes(layer) ? layer : "",
    source: source.value,
  };
}

let waiting: PenPoint[] = [];
let scheduled = false;

function flush(): void {
  if (waiting.length > 0) model.paintTo(waiting);
  waiting = [];
}

/** The pen goes down. */
export function begin(view: string, point: PenPoint, straight: boolean): void {
  waiting = [point];
  model.paintBegin(view, settings(), every.value, straight);
  flush();
}

/** It moves: every point counts, and they go out together once per displayed frame. */
export function to(points: PenPoint[]): void {
  waiting.push(...points);
  if (scheduled) return;
  scheduled = true;
  requestAnimationFrame(() => {
    scheduled = false;
    flush();
  });
}

/** It goes up. */
export function end(): void {
  flush();
  model.paintEnd();
}

export function whole(): void {
  model.paintWhole(settings());
}

const ring = document.createElement("div");
ring.className = "brush-ring";
ring.hidden = true;

/** Show how far the brush reaches about a place of the page; radius in its pixels. */
export function showRing(x: number, y: number, radius: number): void {
  if (!ring.isConnected) document.body.append(ring);
  ring.hidden = false;
  ring.style.width = ring.style.height = `${2 * radius}px`;
  ring.style.left = `${x}px`;
  ring.style.top = `${y}px`;
}

export function hideRing(): void {
  ring.hidden = true;
}
