// What the page knows, as signals, and the things a person can do, as functions.
import { batch, computed, signal, type Signal } from "@preact/signals";
import { Connection, type Link } from "./connection";
import { Kind, type Frame } from "./frames";
import type {
  Appearance,
  Brushes,
  BrushSettings,
  CurveData,
  Curves,
  Crop,
  FromServer,
  LayerInfo,
  Lights,
  MapData,
  ObjectData,
  ObjectValues,
  Progress,
  Reference,
  RGB,
  SnapshotData,
  State,
  Value,
  Welcome,
} from "./messages";
import { now } from "./worker_messages";

export const link = signal<Link>("connecting");
export const welcome = signal<Welcome | null>(null);
/** The parts of the last State, each a signal of its own, so that a drag redraws what it moves. */
export const selected = signal<string[]>([]);
export const history = signal<string[]>([]);
export const position = signal(0);
export const warnings = signal<string[]>([]);
export const saved = signal(true);
export const materials = signal<Record<string, ObjectValues>>({});
export const curves = signal<Curves | null>(null);
export const appearance = signal<Appearance | null>(null);
export const progress = signal<Progress | null>(null);
export const lights = signal<Lights | null>(null);
export const brushes = signal<Brushes | null>(null);
export const snapshots = signal<SnapshotData[]>([]);
export const reference = signal<Reference | null>(null);

export interface Toast {
  id: number;
  level: "info" | "warning" | "error";
  text: string;
  offer: "" | "recover";
}
export const toasts = signal<Toast[]>([]);

/** How the picture is shown; the server takes no part in it. */
export const exposure = signal(0);
export const temperature = signal(6500);
export const tint = signal(0);
export const pickedWhite = signal<RGB | null>(null);
export const operator = signal("srgb");

export type Comparison = "off" | "wipe" | "other" | "difference";
export const comparison = signal<Comparison>("off");
export const comparedWith = signal("");
export const wipe = signal(0.5);

export const hovered = signal("");
/** Which panel is open beside the picture. */
export const tab = signal<"material" | "mix" | "lights" | "paint">("material");
export const panelsHidden = signal(false);
export const helpOpen = signal(false);
export const histogramOpen = signal(true);
export const pickingWhite = signal(false);
/** The next drag in the picture marks the reference's rectangle. */
export const pickingCrop = signal(false);
/** The rectangle that a reference is asked for, and its view; null for whole frames. */
export const crop = signal<{ view: string; pixels: Crop } | null>(null);
export const shownViews = signal<string[]>([]);

export interface Probe {
  view: string;
  x: number;
  y: number;
  linear: RGB;
  object: string;
}
export const probe = signal<Probe | null>(null);
export const zoom = signal(1);
/** Whether denoised pictures stand in for noisy ones at rest. */
export const resting = computed(() => progress.value?.resting ?? false);

/** Layers of the objects that have been given other models than the scene's. */
const otherLayers = signal<Record<string, LayerInfo[]>>({});
export const objects = computed<ObjectData[]>(() =>
  (welcome.value?.objects ?? []).map((item) => {
    const layers = otherLayers.value[item.id];
    return layers ? { ...item, layers } : item;
  }),
);
export const selectedObject = computed<ObjectData | null>(
  () => objects.value.find((item) => item.id === selected.value[0]) ?? null,
);

const DRAG_STATE_MS = 120;

type FrameListener = (frame: Frame) => void;
const listeners = new Set<FrameListener>();
const latest = new Map<string, Frame>();

/** Be told of every frame, beginning with those that are here; returns how to stop that. */
export function onFrame(listener: FrameListener): () => void {
  listeners.add(listener);
  for (const frame of latest.values()) listener(frame);
  return () => listeners.delete(listener);
}

let toastNumber = 0;

/** Words for the user, in a corner. */
export function say(level: Toast["level"], text: string, offer: Toast["offer"] = ""): void {
  const id = ++toastNumber;
  toasts.value = [...toasts.value.filter((t) => t.text !== text), { id, level, text, offer }].slice(-4);
  if (!offer) setTimeout(() => dismiss(id), level === "error" ? 12000 : 6000);
}

export function dismiss(id: number): void {
  toasts.value = toasts.value.filter((t) => t.id !== id);
}

/** Keep the old list when the new one says the same. */
function renew(target: Signal<string[]>, next: string[]): void {
  const now = target.peek();
  if (now.length !== next.length || now.some((text, i) => text !== next[i])) target.value = next;
}

let dragging = false;
/** The State that a drag has kept waiting, and when it is taken up. */
let waitingState: State | null = null;
let stateTimer = 0;

/** While something is dragged, the panels are drawn anew a few times a second: the hand's own
 * control shows its value by itself, and the picture has the processor. */
function onState(message: State): void {
  waitingState = waitingState
    ? { ...message, materials: { ...waitingState.materials, ...message.materials } }
    : message;
  if (!dragging) takeState();
  else if (!stateTimer) stateTimer = window.setTimeout(takeState, DRAG_STATE_MS);
}

function takeState(): void {
  clearTimeout(stateTimer);
  stateTimer = 0;
  const message = waitingState;
  waitingState = null;
  if (!message) return;
  batch(() => {
    if (Object.keys(message.materials).length > 0) {
      materials.value = { ...materials.peek(), ...message.materials };
    }
    if (JSON.stringify(message.layers) !== JSON.stringify(otherLayers.peek())) {
      otherLayers.value = message.layers;
    }
    renew(selected, message.selected);
    renew(history, message.history);
    renew(warnings, message.warnings);
    position.value = message.position;
    saved.value = message.saved;
  });
}

let run = "";

function onMessage(message: FromServer): void {
  switch (message.type) {
    case "Welcome":
      if (run && run !== message.run) say("info", "The editor was restarted; this is its state now.");
      run = message.run;
      if (shownViews.value.length === 0) {
        shownViews.value = message.views.slice(0, 1).map((v) => v.name);
      }
      welcome.value = message;
      watch();
      break;
    case "State":
      onState(message);
      break;
    case "Curves":
      curves.value = message;
      break;
    case "Appearance":
      appearance.value = message;
      break;
    case "Lights":
      lights.value = message;
      break;
    case "Brushes":
      brushes.value = message;
      break;
    case "Progress":
      progress.value = message;
      break;
    case "Snapshots":
      snapshots.value = message.items;
      break;
    case "Reference":
      if (message.status === "failed" && reference.value?.status !== "failed") {
        say("error", `The reference could not be rendered: ${message.text}`);
      }
      reference.value = message;
      break;
    case "Notice":
      say(message.level, message.text, message.offer);
      break;
    case "Refused":
      say("warning", message.text);
      break;
  }
}

const connection = new Connection({
  onMessage,
  onFrame(frame) {
    latest.set(`${frame.kind} ${frame.view}`, frame);
    for (const listener of listeners) listener(frame);
    // A view that is not mounted yet cannot say so itself, and the next one would wait for it.
    const name = welcome.value?.views[frame.view]?.name ?? "";
    if (!mounted.has(name)) shown(frame);
  },
  onLink(value) {
    link.value = value;
  },
  onOpen() {},
});

export const connect = (): void => connection.open();

function watch(): void {
  connection.send({ type: "Watch", views: shownViews.value });
}

/** Show these views side by side. */
export function showViews(names: string[]): void {
  if (names.length === 0) return;
  shownViews.value = names;
  watch();
}

/** The views that are on the page now and acknowledge their own frames. */
export const mounted = new Set<string>();

export const shown = (frame: Frame): void => {
  if (frame.kind === Kind.Picture) {
    connection.send({
      type: "Shown",
      frame: frame.frame,
      held: (now() - frame.arrived) / 1000,
    });
  }
};

// -- edits ---------------------------------------------------------------------------------

export const select = (ids: string[]): void => connection.send({ type: "Select", objects: ids });

/** A drag begins: what it sets is one step of undo. */
export function beginDrag(): void {
  if (!dragging) connection.send({ type: "Gesture", active: true });
  dragging = true;
}

export function endDrag(): void {
  if (dragging) connection.send({ type: "Gesture", active: false });
  dragging = false;
  takeState();
}

export const setValue = (path: string, value: Value): void =>
  connection.sendLatest(`value ${path}`, { type: "SetValue", path, value });
export const setMap = (path: string, file: string | null, map: MapData): void =>
  file === null
    ? connection.sendLatest(`map ${path}`, { type: "SetMap", path, file, map })
    : connection.send({ type: "SetMap", path, file, map });
export const clearMap = (path: string): void => connection.send({ type: "ClearMap", path });
export const setWeight = (layer: string, weight: number): void =>
  connection.sendLatest(`weight ${layer}`, { type: "SetWeight", layer, weight });
export const setCurve = (layer: string, curve: CurveData | null): void =>
  connection.sendLatest(`curve ${layer}`, { type: "SetCurve", layer, curve });
export const setOutgoingCurve = (layer: string, curve: CurveData | null): void =>
  connection.sendLatest(`outgoing ${layer}`, { type: "SetOutgoingCurve", layer, curve });
export const setSecondCurve = (layer: string, curve: CurveData | null): void =>
  connection.sendLatest(`second ${layer}`, { type: "SetSecondCurve", layer, curve });
export const setModel = (layer: string, model: string): void =>
  connection.send({ type: "SetModel", layer, model });
export const setMetal = (layer: string, metal: string): void =>
  connection.send({ type: "SetMetal", layer, metal });
export const setEnabled = (layer: string, enabled: boolean): void =>
  connection.send({ type: "SetEnabled", layer, enabled });
export const solo = (layer: string): void => connection.send({ type: "Solo", layer });
export const reset = (path: string | null): void => connection.send({ type: "Reset", path });
export const undo = (): void => connection.send({ type: "Undo" });
export const redo = (): void => connection.send({ type: "Redo" });
export const goTo = (position: number): void => connection.send({ type: "GoTo", position });
export const inspect = (theta: number): void =>
  connection.sendLatest("inspect", { type: "Inspect", theta_i: theta });
export const loadEdits = (text: string): void => connection.send({ type: "LoadEdits", text });
export const recover = (accept: boolean): void => connection.send({ type: "Recover", accept });

/** Denoise pictures at rest, or not, where that is possible. */
export function toggleDenoise(): void {
  if (!welcome.value?.denoiser) connection.send({ type: "Denoise", active: !progress.value?.denoise });
}

// -- painting ------------------------------------------------------------------------------

export const paintBegin = (view: string, settings: BrushSettings, every: boolean, straight: boolean): void =>
  connection.send({ type: "PaintBegin", view, settings, every, straight });
export const paintTo = (points: [number, number, number][]): void => connection.send({ type: "PaintTo", points });
export const paintEnd = (): void => connection.send({ type: "PaintEnd" });
export const paintWhole = (settings: BrushSettings): void => connection.send({ type: "PaintWhole", settings });

// -- comparing -----------------------------------------------------------------------------

export const takeSnapshot = (label: string, view: string, thumbnail: string): void =>
  connection.send({ type: "TakeSnapshot", label, view, thumbnail });
export const restoreSnapshot = (snapshot: number): void =>
  connection.send({ type: "RestoreSnapshot", snapshot });
export const forgetSnapshot = (snapshot: number): void =>
  connection.send({ type: "ForgetSnapshot", snapshot });

export function compareSnapshot(item: SnapshotData): void {
  connection.send({ type: "CompareSnapshot", snapshot: item.id });
  comparedWith.value = item.label;
  comparison.value = "wipe";
}

export function pathTrace(view: string, spp: number, crop: Crop | null): void {
  connection.send({ type: "PathTrace", view, spp, crop });
  comparedWith.value = "Reference";
  comparison.value = "wipe";
}

export const cancelPathTrace = (): void => connection.send({ type: "CancelPathTrace" });

/** Fetch a file of the server and hand it to the browser's downloads. */
export function download(path: string): void {
  const anchor = document.createElement("a");
  anchor.href = path;
  anchor.download = "";
  anchor.click();
}
