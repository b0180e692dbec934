// Saving and loading: edits as a file, the picture as EXR (linear) or PNG (as shown).
import * as model from "../model";
import { handles } from "../viewer/view";

export const saveEdits = (): void => model.download("edits.json");

export function saveExr(): void {
  model.download(`picture.exr?view=${encodeURIComponent(model.shownViews.value[0] ?? "")}`);
}

export function savePng(): void {
  const view = model.shownViews.value[0] ?? "";
  const picture = handles.get(view)?.picture(Infinity);
  picture?.toBlob((blob) => {
    if (!blob) return;
    const url = URL.createObjectURL(blob);
    const anchor = document.createElement("a");
    anchor.href = url;
    anchor.download = `${model.welcome.value?.session ?? "picture"}-${view}.png`;
    anchor.click();
    setTimeout(() => URL.revokeObjectURL(url), 10000);
  }, "image/png");
}

export function openEdits(): void {
  const input = document.createElement("input");
  input.type = "file";
  input.accept = ".json,application/json";
  input.onchange = async () => {
    const file = input.files?.[0];
    if (!file) return;
    if (file.size > 3_000_000) model.say("warning", `${file.name} is too large to be an edits file.`);
    else model.loadEdits(await file.text());
  };
  input.click();
}
