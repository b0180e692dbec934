// Files, undo, and how the picture is shown.
import { useEffect } from "preact/hooks";
import { Slider } from "../controls/slider";
import * as model from "../model";
import { openEdits, saveEdits, saveExr, savePng } from "./files";

const NAMES: Record<string, string> = {
  srgb: "Linear (sRGB)",
  reinhard: "Reinhard",
  filmic: "Filmic",
  aces: "ACES",
  agx: "AgX",
};

export function TopBar() {
  const session = model.welcome.value?.session ?? "";
  const unsaved = !model.saved.value;
  useEffect(() => {
    document.title = session ? `${unsaved ? "• " : ""}${session} — burnish` : "burnish";
  }, [session, unsaved]);
  const views = model.welcome.value?.views ?? [];
  return (
    <header class="topbar">
      <h1 title={unsaved ? "There are edits that no file holds; they are autosaved" : "All edits are in a file"}>
        <img src="icon.svg" alt="" width={18} height={18} />
        {session || "burnish"}
        {unsaved && <span class="dot" aria-label="unsaved edits" />}
      </h1>
      <nav aria-label="File">
        <button title="Undo (Ctrl+Z)" aria-label="Undo" disabled={model.position.value === 0} onClick={model.undo}>
          ↶
        </button>
        <button title="Redo (Ctrl+Y)" aria-label="Redo" disabled={model.position.value === model.history.value.length} onClick={model.redo}>
          ↷
        </button>
        <button title="Load edits from a file" onClick={openEdits}>
          Open
        </button>
        <button title="Save the edits as a file (Ctrl+S)" onClick={saveEdits}>
          Save
        </button>
        <button title="Save the picture in linear light (EXR)" onClick={saveExr}>
          EXR
        </button>
        <button title="Save the picture as it is shown (PNG)" onClick={savePng}>
          PNG
        </button>
      </nav>
      {views.length > 1 && (
        <div class="views" role="group" aria-label="Views">
          {views.map((view) => {
            const on = model.shownViews.value.includes(view.name);
            return (
              <button
                key={view.name}
                aria-pressed={on}
                title={`${view.width} × ${view.height}`}
                onClick={() =>
                  model.showViews(
                    on ? model.shownViews.value.filter((n) => n !== view.name) : views.map((v) => v.name).filter((n) => n === view.name || model.shownViews.value.includes(n)),
                  )
                }
              >
                {view.name}
              </button>
            );
          })}
        </div>
      )}
      <span class="spacer" />
      <div class="looking" role="group" aria-label="Display">
        <Slider
          label="Exposure"
          value={model.exposure.value}
          initial={0}
          minimum={-20}
          maximum={20}
          softMinimum={-6}
          softMaximum={6}
          unit="stops"
          tip="Of the display alone (E, Shift+E)"
          onChange={(next) => (model.exposure.value = next)}
          onReset={() => (model.exposure.value = 0)}
        />
        <Slider
          label="White"
          value={model.temperature.value}
          initial={6500}
          minimum={1700}
          maximum={25000}
          softMinimum={2500}
          softMaximum={12000}
          unit="K"
          tip="Colour temperature that is shown as neutral"
          onChange={(next) => {
            model.pickedWhite.value = null;
            model.temperature.value = next;
          }}
          onReset={() => {
            model.pickedWhite.value = null;
            model.temperature.value = 6500;
            model.tint.value = 0;
          }}
        />
        <button
          aria-pressed={model.pickingWhite.value || model.pickedWhite.value !== null}
          title="Click a pixel that should be neutral; again to take that back"
          onClick={() => {
            if (model.pickedWhite.value) model.pickedWhite.value = null;
            else model.pickingWhite.value = !model.pickingWhite.value;
          }}
        >
          Pick
        </button>
        <select aria-label="Tone mapping" title="Tone mapping of the display" value={model.operator.value} onChange={(e) => (model.operator.value = e.currentTarget.value)}>
          {(model.welcome.value?.tone_mappings ?? ["srgb"]).map((name) => (
            <option key={name} value={name}>
              {NAMES[name] ?? name}
            </option>
          ))}
        </select>
      </div>
      <button title="Hide or show the panels (H)" onClick={() => (model.panelsHidden.value = !model.panelsHidden.value)}>
        Panels
      </button>
      <button title="Keys (?)" aria-label="Keys" onClick={() => (model.helpOpen.value = true)}>
        ?
      </button>
    </header>
  );
}
