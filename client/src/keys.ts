// Keys that work everywhere but in text boxes.
import * as model from "./model";
import { keepLook } from "./panels/compare";
import { saveEdits } from "./panels/files";
import * as painting from "./painting";
import { handles } from "./viewer/view";

let before: model.Comparison = "off";

function typing(target: EventTarget | null): boolean {
  return target instanceof HTMLInputElement && !["range", "checkbox"].includes(target.type);
}

export function listen(): void {
  window.addEventListener("keydown", (event) => {
    const key = event.key.toLowerCase();
    if (event.ctrlKey || event.metaKey) {
      if (key === "z" && event.shiftKey) model.redo();
      else if (key === "z") model.undo();
      else if (key === "y") model.redo();
      else if (key === "s") saveEdits();
      else return;
      event.preventDefault();
      return;
    }
    if (event.altKey || typing(event.target) || document.querySelector("dialog[open]")) return;
    const actions: Record<string, () => void> = {
      f: () => handles.forEach((view) => view.fit()),
      "1": () => handles.forEach((view) => view.actualSize()),
      e: () => (model.exposure.value += event.shiftKey ? -0.5 : 0.5),
      k: keepLook,
      w: () => (model.comparison.value = model.comparison.value === "wipe" ? "off" : "wipe"),
      d: model.toggleDenoise,
      g: () => (model.histogramOpen.value = !model.histogramOpen.value),
      h: () => (model.panelsHidden.value = !model.panelsHidden.value),
      "?": () => (model.helpOpen.value = true),
      "[": () => painting.resize(false),
      "]": () => painting.resize(true),
      escape: () => {
        if (painting.active.value) painting.brush.value = "";
        else model.select([]);
      },
      b: () => {
        if (event.repeat) return;
        before = model.comparison.value;
        model.comparison.value = "other";
      },
    };
    const action = actions[key];
    if (!action) return;
    action();
    event.preventDefault();
  });
  window.addEventListener("keyup", (event) => {
    if (event.key.toLowerCase() === "b" && model.comparison.value === "other") {
      model.comparison.value = before === "other" ? "off" : before;
    }
  });
}
