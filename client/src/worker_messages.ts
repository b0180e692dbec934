// What the page and the worker that holds its websocket say to each other.
import type { Frame } from "./frames";

export type ToWorker = { kind: "open" } | { kind: "send"; text: string };

export type FromWorker =
  | { kind: "open" }
  | { kind: "close"; code: number }
  | { kind: "text"; text: string }
  | { kind: "frame"; frame: Frame }
  | { kind: "dropped"; frame: number; text: string };

/** Milliseconds by a clock that both share. */
export const now = (): number => performance.timeOrigin + performance.now();
