// A view: the picture on its canvas, with pan, zoom, hovering, selecting and the wipe.
import { effect, signal, type Signal } from "@preact/signals";
import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import { whiteOf } from "../colour";
import { Kind, type Frame } from "../frames";
import { HALF } from "../halves";
import type { Crop, RGB, ViewData } from "../messages";
import * as model from "../model";
import * as painting from "../painting";
import { Gizmos, type Standing } from "./gizmo";
import { Renderer, type Look } from "./renderer";
import { OPERATORS } from "./shaders";

const COMPARISONS: model.Comparison[] = ["off", "wipe", "other", "difference"];
const GLOW_MS = 1100;
const still = matchMedia("(prefers-reduced-motion: reduce)");
const CLICK_PIXELS = 4;
const FRAME_MS = 12;
/** Pixels of a rectangle's shorter side; the server refuses smaller ones. */
export const LEAST_CROP = 16;

/** What other parts of the page may ask of a shown view. */
export interface ViewHandle {
  name: string;
  fit(): void;
  actualSize(): void;
  picture(width: number): HTMLCanvasElement | null;
  latest(): Frame | null;
  /** The pixels that the canvas shows. */
  visible(): Crop;
}
export const handles = new Map<string, ViewHandle>();

/** The factor on each channel: exposure, and a white that is shown as neutral. */
export function gainOf(): RGB {
  const white = model.pickedWhite.value ?? whiteOf(model.temperature.value, model.tint.value);
  const mean = (white[0] + white[1] + white[2]) / 3;
  const exposure = 2 ** model.exposure.value;
  return [(exposure * mean) / white[0], (exposure * mean) / white[1], (exposure * mean) / white[2]];
}

export function View({ data, index }: { data: ViewData; index: number }) {
  const canvasRef = useRef<HTMLCanvasElement>(null);
  const marking = useRef<HTMLDivElement>(null);
  const [problem, setProblem] = useState("");
  const [waiting, setWaiting] = useState(true);
  const standing = useMemo(() => signal<Standing>({ x: 0, y: 0, scale: 1, width: 1, height: 1 }), []);

  useEffect(() => {
    const canvas = canvasRef.current;
    if (!canvas) return;
    let renderer: Renderer;
    try {
      renderer = new Renderer(canvas);
    } catch (error) {
      setProblem(error instanceof Error ? error.message : String(error));
      return;
    }
    const controller = new Controller(canvas, marking.current, renderer, data, index, standing, () => setWaiting(false));
    handles.set(data.name, controller);
    model.mounted.add(data.name);
    return () => {
      handles.delete(data.name);
      model.mounted.delete(data.name);
      controller.close();
      renderer.close();
    };
  }, [data, index]);

  return (
    <figure class="view" aria-label={`View ${data.name}`}>
      <canvas ref={canvasRef} tabIndex={0} role="img" aria-label={`Picture of view ${data.name}`} />
      <div ref={marking} class="marking" hidden />
      <Gizmos data={data} standing={standing} />
      {problem && <p class="problem" role="alert">{problem}</p>}
      {waiting && !problem && <p class="waiting" role="status">Waiting for the first picture …</p>}
      {model.shownViews.value.length > 1 && <figcaption>{data.name}</figcaption>}
    </figure>
  );
}

class Controller implements ViewHandle {
  readonly name: string;
  private origin: [number, number] = [0, 0];
  private scale = 1;
  private fitted = true;
  private objects: Uint16Array | null = null;
  private picture16: Frame | null = null;
  private resting: Frame | null = null;
  private waitingToShow: Frame[] = [];
  private scheduled = false;
  private drawnAt = -1;
  private glowUntil = 0;
  private drag: { x: number; y: number; moved: boolean; kind: "pan" | "wipe" | "crop" | "paint"; from: [number, number] } | null = null;
  private readonly stops: (() => void)[] = [];

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly marking: HTMLElement | null,
    private readonly renderer: Renderer,
    private readonly data: ViewData,
    private readonly index: number,
    private readonly standing: Signal<Standing>,
    private readonly onFirst: () => void,
  ) {
    this.name = data.name;
    this.stops.push(model.onFrame((frame) => this.take(frame)));
    const observer = new ResizeObserver(([entry]) => {
      // Exact at every scale of the screen, where the browser tells it.
      const exact = entry?.devicePixelContentBoxSize?.[0];
      this.resize(exact?.inlineSize, exact?.blockSize);
    });
    try {
      observer.observe(canvas, { box: "device-pixel-content-box" });
    } catch {
      observer.observe(canvas);
    }
    this.stops.push(() => observer.disconnect());
    const listen = <K extends keyof HTMLElementEventMap>(
      kind: K,
      handler: (event: HTMLElementEventMap[K]) => void,
    ) => {
      canvas.addEventListener(kind, handler, { passive: false });
      this.stops.push(() => canvas.removeEventListener(kind, handler));
    };
    listen("wheel", (event) => this.wheel(event));
    listen("pointerdown", (event) => this.press(event));
    listen("pointermove", (event) => this.move(event));
    listen("pointerup", (event) => this.release(event));
    listen("pointercancel", (event) => this.release(event));
    listen("pointerleave", () => this.leave());
    listen("dblclick", (event) => event.preventDefault());
    listen("keydown", (event) => this.key(event));
    let lastSelected = "";
    this.stops.push(
      effect(() => {
        const now = model.selected.value.join();
        if (now !== lastSelected) {
          lastSelected = now;
          if (!still.matches) this.glowUntil = performance.now() + GLOW_MS;
        }
        if (!model.resting.value) this.resting = null;
        // Everything that the look reads; a change of any of it draws anew.
        gainOf();
        void [model.operator.value, model.comparison.value, model.wipe.value, model.hovered.value, model.crop.value];
        this.schedule();
      }),
    );
    this.resize();
  }

  close(): void {
    for (const stop of this.stops) stop();
  }

  latest(): Frame | null {
    return this.picture16;
  }

  fit(): void {
    const [w, h] = [this.data.width, this.data.height];
    const [cw, ch] = [this.canvas.width, this.canvas.height];
    this.scale = Math.min(cw / w, ch / h);
    // Whole multiples keep pixels square and equal.
    if (this.scale > 2) this.scale = Math.floor(this.scale);
    this.origin = [Math.round((cw - w * this.scale) / 2), Math.round((ch - h * this.scale) / 2)];
    this.fitted = true;
    this.zoomed();
  }

  actualSize(): void {
    const [cw, ch] = [this.canvas.width, this.canvas.height];
    this.scale = 1;
    this.origin = [
      Math.round((cw - this.data.width) / 2),
      Math.round((ch - this.data.height) / 2),
    ];
    this.fitted = false;
    this.zoomed();
  }

  picture(width: number): HTMLCanvasElement | null {
    return this.renderer.has(Kind.Picture) ? this.renderer.snapshot(this.look(), width) : null;
  }

  private take(frame: Frame): void {
    if (frame.view !== this.index) return;
    if (frame.kind === Kind.Objects) this.objects = frame.pixels;
    if (frame.kind === Kind.Picture) {
      this.picture16 = frame;
      this.waitingToShow.push(frame);
      this.onFirst();
    }
    if (frame.kind === Kind.Resting) this.resting = frame;
    this.renderer.upload(frame);
    // The first of a displayed frame is drawn at once and misses none; others wait for the next.
    if (frame.kind === Kind.Picture && !this.scheduled && performance.now() - this.drawnAt > FRAME_MS) this.draw();
    else this.schedule();
  }

  private schedule(): void {
    if (this.scheduled) return;
    this.scheduled = true;
    requestAnimationFrame(() => {
      this.scheduled = false;
      this.draw();
    });
  }

  private draw(): void {
    this.drawnAt = performance.now();
    this.renderer.draw(this.look());
    this.mark();
    this.stand();
    for (const frame of this.waitingToShow) model.shown(frame);
    this.waitingToShow = [];
    if (performance.now() < this.glowUntil) this.schedule();
  }

  /** Say where the picture stands to what lies over it. */
  private stand(): void {
    const [x, y] = this.origin;
    const now: Standing = { x, y, scale: this.scale, width: this.canvas.width, height: this.canvas.height };
    const before = this.standing.peek();
    if ((Object.keys(now) as (keyof Standing)[]).some((key) => now[key] !== before[key])) this.standing.value = now;
  }

  /** Put the frame about the rectangle that a reference is asked for. */
  private mark(): void {
    const { marking } = this;
    const chosen = model.crop.value;
    if (!marking) return;
    marking.hidden = chosen?.view !== this.name;
    if (!chosen || marking.hidden) return;
    const [left, top, width, height] = chosen.pixels;
    const ratio = devicePixelRatio;
    const { style } = marking;
    style.left = `${(this.origin[0] + left * this.scale) / ratio}px`;
    style.top = `${(this.origin[1] + top * this.scale) / ratio}px`;
    style.width = `${(width * this.scale) / ratio}px`;
    style.height = `${(height * this.scale) / ratio}px`;
  }

  visible(): Crop {
    const { width, height } = this.data;
    const clamp = (x: number, most: number) => Math.min(Math.max(Math.round(x), 0), most);
    const left = clamp(-this.origin[0] / this.scale, width);
    const top = clamp(-this.origin[1] / this.scale, height);
    const right = clamp((this.canvas.width - this.origin[0]) / this.scale, width);
    const bottom = clamp((this.canvas.height - this.origin[1]) / this.scale, height);
    return [left, top, right - left, bottom - top];
  }

  private look(): Look {
    const numberOf = (id: string) => model.objects.value.findIndex((item) => item.id === id) + 1;
    const left = (this.glowUntil - performance.now()) / GLOW_MS;
    return {
      origin: this.origin,
      zoom: this.scale,
      gain: gainOf(),
      operator: Math.max(OPERATORS.indexOf(model.operator.value as (typeof OPERATORS)[number]), 0),
      comparison: COMPARISONS.indexOf(model.comparison.value),
      // Of this very state: while something is dragged the picture is newer.
      resting: this.resting !== null && this.resting.revision === this.picture16?.revision,
      wipe: model.wipe.value,
      hovered: numberOf(model.hovered.value),
      selected: numberOf(model.selected.value[0] ?? ""),
      glow: Math.max(Math.min(2 * left, 1), 0),
      pixelRatio: devicePixelRatio,
    };
  }

  private resize(exactWidth?: number, exactHeight?: number): void {
    const { clientWidth, clientHeight } = this.canvas;
    const width = Math.max(exactWidth ?? Math.round(clientWidth * devicePixelRatio), 1);
    const height = Math.max(exactHeight ?? Math.round(clientHeight * devicePixelRatio), 1);
    if (width === this.canvas.width && height === this.canvas.height) return;
    const [dx, dy] = [(width - this.canvas.width) / 2, (height - this.canvas.height) / 2];
    this.canvas.width = width;
    this.canvas.height = height;
    if (this.fitted) this.fit();
    else this.origin = [Math.round(this.origin[0] + dx), Math.round(this.origin[1] + dy)];
    this.renderer.draw(this.look());
  }

  private zoomed(): void {
    model.zoom.value = this.scale;
    this.schedule();
  }

  private at(event: MouseEvent): [number, number] {
    const box = this.canvas.getBoundingClientRect();
    const x = (event.clientX - box.left) * devicePixelRatio;
    const y = (event.clientY - box.top) * devicePixelRatio;
    return [(x - this.origin[0]) / this.scale, (y - this.origin[1]) / this.scale];
  }

  private objectAt(x: number, y: number): string {
    const [px, py] = [Math.floor(x), Math.floor(y)];
    if (px < 0 || py < 0 || px >= this.data.width || py >= this.data.height) return "";
    const number = this.objects?.[py * this.data.width + px] ?? 0;
    return model.objects.value[number - 1]?.id ?? "";
  }

  private linearAt(x: number, y: number): RGB | null {
    const [px, py] = [Math.floor(x), Math.floor(y)];
    if (px < 0 || py < 0 || px >= this.data.width || py >= this.data.height) return null;
    const pixels = this.picture16?.pixels;
    if (!pixels) return null;
    const i = 3 * (py * this.data.width + px);
    const value = (k: number) => HALF[pixels[i + k] ?? 0] ?? 0;
    return [value(0), value(1), value(2)];
  }

  private wheel(event: WheelEvent): void {
    event.preventDefault();
    this.zoomBy(2 ** (-event.deltaY / 240), this.at(event));
  }

  private zoomBy(factor: number, [px, py]: [number, number]): void {
    const scale = Math.min(Math.max(this.scale * factor, 0.05), 64);
    this.origin = [
      this.origin[0] + px * (this.scale - scale),
      this.origin[1] + py * (this.scale - scale),
    ];
    this.scale = scale;
    this.fitted = false;
    this.zoomed();
  }

  /** Whether a place is on the line of the wipe. */
  private onWipe(x: number): boolean {
    const [left, right] = this.renderer.compared;
    const line = left + model.wipe.value * (right - left);
    return model.comparison.value === "wipe" && Math.abs(x - line) * this.scale < 8 * devicePixelRatio;
  }

  private press(event: PointerEvent): void {
    const from = this.at(event);
    const paints = painting.active.value && event.button === 0 && !model.pickingWhite.value;
    if (paints && event.altKey) {
      painting.source.value = from;
      return;
    }
    const kind = model.pickingCrop.value ? "crop" : this.onWipe(from[0]) ? "wipe" : paints ? "paint" : "pan";
    this.drag = { x: event.clientX, y: event.clientY, moved: false, kind, from };
    try {
      this.canvas.setPointerCapture(event.pointerId);
    } catch {
      // A pointer that has gone by now cannot be captured; the drag ends by itself.
    }
    if (kind === "paint") painting.begin(this.name, this.pen(event), event.shiftKey);
  }

  private move(event: PointerEvent): void {
    const [x, y] = this.at(event);
    const { drag } = this;
    this.ring(event);
    if (drag) {
      if (drag.kind === "paint") {
        const all = event.getCoalescedEvents?.() ?? [];
        painting.to((all.length > 0 ? all : [event]).map((each) => this.pen(each)));
        return;
      }
      const [dx, dy] = [event.clientX - drag.x, event.clientY - drag.y];
      if (drag.kind === "wipe") {
        const [left, right] = this.renderer.compared;
        model.wipe.value = Math.min(Math.max((x - left) / (right - left), 0), 1);
        drag.moved = true;
        return;
      }
      if (drag.kind === "crop") {
        model.crop.value = { view: this.name, pixels: this.between(drag.from, [x, y]) };
        drag.moved = true;
        return;
      }
      if (drag.moved || Math.hypot(dx, dy) > CLICK_PIXELS) {
        drag.moved = true;
        this.origin = [
          this.origin[0] + dx * devicePixelRatio,
          this.origin[1] + dy * devicePixelRatio,
        ];
        drag.x = event.clientX;
        drag.y = event.clientY;
        this.fitted = false;
        this.zoomed();
      }
      return;
    }
    const object = this.objectAt(x, y);
    model.hovered.value = object;
    const linear = this.linearAt(x, y);
    model.probe.value = linear
      ? { view: this.name, x: Math.floor(x), y: Math.floor(y), linear, object }
      : null;
    const picking = model.pickingWhite.value || model.pickingCrop.value || painting.active.value;
    this.canvas.style.cursor = picking ? "crosshair" : this.onWipe(x) ? "ew-resize" : "";
  }

  /** Where a pen is, and how hard it presses; a mouse presses fully. */
  private pen(event: PointerEvent): painting.PenPoint {
    const [x, y] = this.at(event);
    return [x, y, event.pointerType === "pen" ? event.pressure : 1];
  }

  private ring(event: PointerEvent): void {
    if (!painting.active.value) return painting.hideRing();
    painting.showRing(event.clientX, event.clientY, (painting.size.value * this.scale) / devicePixelRatio);
  }

  /** The pixels between two places, inside the picture. */
  private between(a: [number, number], b: [number, number]): Crop {
    const clamp = (x: number, most: number) => Math.min(Math.max(x, 0), most);
    const { width, height } = this.data;
    const [left, right] = [Math.min(a[0], b[0]), Math.max(a[0], b[0])].map((x) => Math.round(clamp(x, width)));
    const [top, bottom] = [Math.min(a[1], b[1]), Math.max(a[1], b[1])].map((y) => Math.round(clamp(y, height)));
    return [left!, top!, right! - left!, bottom! - top!];
  }

  private release(event: PointerEvent): void {
    const { drag } = this;
    this.drag = null;
    if (drag?.kind === "paint") return painting.end();
    if (drag?.kind === "crop") {
      model.pickingCrop.value = false;
      const [, , width, height] = model.crop.value?.pixels ?? [0, 0, 0, 0];
      if (!drag.moved || Math.min(width, height) < LEAST_CROP) {
        model.crop.value = null;
        model.say("warning", `A rectangle needs at least ${LEAST_CROP} × ${LEAST_CROP} pixels; drag a larger one.`);
      }
      return;
    }
    if (!drag || drag.moved || event.button !== 0) return;
    const [x, y] = this.at(event);
    if (model.pickingWhite.value) {
      const linear = this.linearAt(x, y);
      model.pickingWhite.value = false;
      if (linear && Math.min(...linear) > 0) model.pickedWhite.value = linear;
      else model.say("warning", "That pixel is too dark to be a white.");
      return;
    }
    const object = this.objectAt(x, y);
    if (!event.shiftKey) {
      model.select(object ? [object] : []);
    } else if (object) {
      const others = model.selected.value.filter((id) => id !== object);
      const already = others.length < model.selected.value.length;
      model.select(already ? others : [...others, object]);
    }
  }

  private leave(): void {
    painting.hideRing();
    model.hovered.value = "";
    model.probe.value = null;
  }

  private key(event: KeyboardEvent): void {
    const step = 40 * devicePixelRatio;
    const centre: [number, number] = [this.data.width / 2, this.data.height / 2];
    const moves: Record<string, [number, number]> = {
      ArrowLeft: [step, 0],
      ArrowRight: [-step, 0],
      ArrowUp: [0, step],
      ArrowDown: [0, -step],
    };
    const by = moves[event.key];
    if (by) {
      this.origin = [this.origin[0] + by[0], this.origin[1] + by[1]];
      this.fitted = false;
      this.zoomed();
    } else if (event.key === "+" || event.key === "=") {
      this.zoomBy(Math.SQRT2, centre);
    } else if (event.key === "-") {
      this.zoomBy(Math.SQRT1_2, centre);
    } else {
      return;
    }
    event.preventDefault();
  }
}
