// Handles on the lights in a picture: one to move a light, one to aim it.
import type { Signal } from "@preact/signals";
import { useMemo, useRef } from "preact/hooks";
import type { LightData, ViewData } from "../messages";
import * as model from "../model";
import * as placing from "../placing";
import { Camera, type Place } from "./camera";

/** Where the picture stands on the canvas, in the screen's pixels. */
export interface Standing {
  x: number;
  y: number;
  scale: number;
  width: number;
  height: number;
}

const ARROW = 70;
const EDGE = 12;
/** Screen pixels that a drag with Shift takes to go e times as deep. */
const DEPTH = 160;

type XY = [number, number];

export function Gizmos({ data, standing }: { data: ViewData; standing: Signal<Standing> }) {
  const camera = useMemo(() => (data.camera.length === 12 ? new Camera(data.camera) : null), [data]);
  if (!camera || !placing.active.value) return null;
  const at = standing.value;
  return (
    <svg class="gizmos" aria-label="Lights in the picture">
      {(model.lights.value?.items ?? []).map((light) => (
        <Gizmo key={light.path} light={light} camera={camera} at={at} />
      ))}
    </svg>
  );
}

function Gizmo({ light, camera, at }: { light: LightData; camera: Camera; at: Standing }) {
  const position = placing.placeOf(light, "position");
  if (!position) return null;
  const [column, row, depth] = camera.project(position);
  // Behind the eye there is nothing to take hold of
  if (!(depth > 0)) return null;
  const direction = placing.placeOf(light, "direction");
  const ratio = devicePixelRatio;
  const screen = (c: number, r: number): XY => [(at.x + c * at.scale) / ratio, (at.y + r * at.scale) / ratio];
  const [x, y] = screen(column, row);
  const clamp = (value: number, most: number) => Math.min(Math.max(value, EDGE), most / ratio - EDGE);
  const [shownX, shownY] = [clamp(x, at.width), clamp(y, at.height)];
  const outside = shownX !== x || shownY !== y;
  const chosen = placing.chosen.value === light.path;
  // How far apart in the world two pixels of the screen are, at the light's depth
  const beside = camera.unproject([column + ratio / at.scale, row, depth]);
  const pixel = Math.hypot(beside[0] - position[0], beside[1] - position[1], beside[2] - position[2]);
  const tip = direction && plus(position, direction, ARROW * pixel);
  const aim = tip && camera.project(tip);
  const arrow = aim && aim[2] > 0 && !outside ? screen(aim[0], aim[1]) : null;
  return (
    <g class={`gizmo${chosen ? " chosen" : ""}${outside ? " outside" : ""}${light.on ? "" : " dark"}`}>
      {arrow && <line x1={x} y1={y} x2={arrow[0]} y2={arrow[1]} />}
      <Handle
        label={`Move light ${light.name}`}
        tip="Drag to move; with Shift up and down to move away and back"
        at={[shownX, shownY]}
        radius={7}
        path={light.path}
        start={[column, row, depth]}
        scale={at.scale}
        onMove={(to) => placing.move(`${light.path}.position`, camera.unproject(to))}
      />
      {arrow && aim && chosen && (
        <Handle
          label={`Aim light ${light.name}`}
          tip="Drag to aim; with Shift up and down to aim away and back"
          at={arrow}
          radius={5}
          path={light.path}
          start={aim}
          scale={at.scale}
          onMove={(to) => placing.move(`${light.path}.direction`, toward(position, camera.unproject(to)))}
        />
      )}
      <text x={shownX + 11} y={shownY - 9}>
        {light.name}
      </text>
    </g>
  );
}

interface HandleProps {
  label: string;
  tip: string;
  at: XY;
  radius: number;
  path: string;
  /** Column, row and depth of what the handle moves. */
  start: Place;
  scale: number;
  onMove(to: Place): void;
}

function Handle({ label, tip, at, radius, path, start, scale, onMove }: HandleProps) {
  // What the hand holds: the place in the picture by its steps, since Shift may come and go
  const drag = useRef<{ to: Place; x: number; y: number } | null>(null);
  const release = () => {
    if (drag.current) placing.end();
    drag.current = null;
  };
  return (
    <circle
      class="handle"
      role="button"
      aria-label={label}
      cx={at[0]}
      cy={at[1]}
      r={radius}
      onPointerDown={(event) => {
        if (event.button !== 0) return;
        event.preventDefault();
        drag.current = { to: start, x: event.clientX, y: event.clientY };
        event.currentTarget.setPointerCapture(event.pointerId);
        placing.begin(path);
      }}
      onPointerMove={(event) => {
        const held = drag.current;
        if (!held) return;
        const [dx, dy] = [event.clientX - held.x, event.clientY - held.y];
        if (dx === 0 && dy === 0) return;
        const step = devicePixelRatio / scale;
        const [column, row, depth] = held.to;
        held.to = event.shiftKey ? [column, row, depth * Math.exp(-dy / DEPTH)] : [column + dx * step, row + dy * step, depth];
        [held.x, held.y] = [event.clientX, event.clientY];
        onMove(held.to);
      }}
      onPointerUp={release}
      onPointerCancel={release}
    >
      <title>{`${label}\n${tip}`}</title>
    </circle>
  );
}

const plus = (a: Place, d: Place, by: number): Place => [a[0] + by * d[0], a[1] + by * d[1], a[2] + by * d[2]];

/** The unit vector from a place to another; straight down where they are one. */
function toward(from: Place, to: Place): Place {
  const d: Place = [to[0] - from[0], to[1] - from[1], to[2] - from[2]];
  const length = Math.hypot(...d);
  return length > 0 ? [d[0] / length, d[1] / length, d[2] / length] : [0, 0, -1];
}
