// Lights that are placed by hand: which one is chosen, and where the hand has it before the server.
import { computed, effect, signal } from "@preact/signals";
import type { LightData } from "./messages";
import * as model from "./model";
import type { Place } from "./viewer/camera";

const ECHO_MS = 5000;

/** The path of the light that is worked on, "" for none. */
export const chosen = signal("");
/** Whether lights can be taken hold of in the picture. */
export const active = computed(() => model.tab.value === "lights" && !model.lights.value?.fixed);

/** Values that the hand has given and the server has not yet said, by path. */
const held = signal<Record<string, Place>>({});
let timer = 0;

/** A place or direction of a light as the hand has it, or null where it has none. */
export function placeOf(light: LightData, name: string): Place | null {
  const own = held.value[`${light.path}.${name}`] ?? light.values[name];
  return Array.isArray(own) ? (own as Place) : null;
}

export function choose(path: string): void {
  chosen.value = path;
  model.tab.value = "lights";
}

export function begin(path: string): void {
  clearTimeout(timer);
  choose(path);
  model.beginDrag();
}

export function move(path: string, value: Place): void {
  held.value = { ...held.value, [path]: value };
  model.setValue(path, value);
}

/** The drag has ended; what was given shows until the server says the same, or for a while. */
export function end(): void {
  model.endDrag();
  timer = window.setTimeout(() => (held.value = {}), ECHO_MS);
}

const close = (a: Place, b: Place) => {
  const size = Math.hypot(...b) + 1e-9;
  return Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]) < 1e-6 * size;
};

effect(() => {
  const items = model.lights.value?.items ?? [];
  const waiting = Object.entries(held.peek());
  const left = waiting.filter(([path, value]) => {
    const light = items.find((item) => path.startsWith(`${item.path}.`));
    const now = light?.values[path.slice((light?.path.length ?? 0) + 1)];
    return !(Array.isArray(now) && close(now as Place, value));
  });
  if (left.length < waiting.length) held.value = Object.fromEntries(left);
});
