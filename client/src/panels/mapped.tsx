// A parameter's map: a picture in place of its one value, how it lies and is scaled.
import { useSignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { NumberBox } from "../controls/number";
import { FileBox } from "../controls/vector";
import type { MapData } from "../messages";
import * as model from "../model";

const CHANNELS: MapData["channel"][] = ["", "red", "green", "blue", "alpha"];
const NONE: MapData = { file: "", channel: "", scale: 1, offset: 0, repeat: [1, 1], rotate: 0 };

interface Props {
  path: string;
  name: string;
  map: MapData | null;
  colour: boolean;
  children: ComponentChildren;
}

export function Mapped({ path, name, map, colour, children }: Props) {
  const open = useSignal(false);
  const shown = map ? map.file.split("/").pop() || "the scene's own" : "";
  return (
    <div class={map ? "mapped has-map" : "mapped"}>
      {children}
      <button
        class="map-button"
        aria-expanded={open.value}
        aria-label={`Map of ${name}`}
        title={map ? `A picture gives ${name}: ${shown}` : `Put a picture in place of ${name}`}
        onClick={() => (open.value = !open.value)}
      >
        ▦
      </button>
      {open.value && <MapBoxes path={path} name={name} map={map} colour={colour} />}
    </div>
  );
}

function MapBoxes({ path, name, map, colour }: Omit<Props, "children">) {
  const now = map ?? NONE;
  const change = (part: Partial<MapData>) => model.setMap(path, null, { ...now, ...part });
  const load = (file: string) => {
    if (file) model.setMap(path, file, now);
  };
  const box = (what: string, value: number, part: (value: number) => Partial<MapData>) => (
    <label>
      {what}
      <NumberBox label={`${what} of the map of ${name}`} value={value} minimum={-1000} maximum={1000} onChange={(next) => change(part(next))} />
    </label>
  );
  return (
    <div class="map-boxes">
      <FileBox label="Picture" value={now.file} tip="A PNG, JPEG or EXR file; Enter loads it" onChange={load} onReset={() => model.reset(path)} />
      {map && (
        <div class="map-numbers">
          {box("Scale", now.scale, (scale) => ({ scale }))}
          {box("Offset", now.offset, (offset) => ({ offset }))}
          {box("Repeat u", now.repeat[0], (u) => ({ repeat: [u, now.repeat[1]] }))}
          {box("Repeat v", now.repeat[1], (v) => ({ repeat: [now.repeat[0], v] }))}
          {box("Turn", now.rotate, (rotate) => ({ rotate }))}
          {!colour && now.file && (
            <label>
              Channel
              <select
                aria-label={`Channel of the map of ${name}`}
                value={now.channel}
                onChange={(event) =>
                  model.setMap(path, now.file, { ...now, channel: event.currentTarget.value as MapData["channel"] })
                }
              >
                {CHANNELS.map((channel) => (
                  <option key={channel} value={channel}>
                    {channel || "luminance"}
                  </option>
                ))}
              </select>
            </label>
          )}
          <button title={`One value of ${name} again: the picture's mean`} onClick={() => model.clearMap(path)}>
            Take off
          </button>
        </div>
      )}
    </div>
  );
}
