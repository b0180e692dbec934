// The keys.
import { useEffect, useRef } from "preact/hooks";
import * as model from "../model";

const KEYS: [string, string][] = [
  ["Ctrl+Z", "Undo"],
  ["Ctrl+Y, Ctrl+Shift+Z", "Redo"],
  ["Ctrl+S", "Save the edits as a file"],
  ["F", "Fit the picture to the window"],
  ["1", "Show pixels one to one"],
  ["E, Shift+E", "Exposure up, down by half a stop"],
  ["K", "Keep this look"],
  ["W", "Wipe between the edited and the other picture"],
  ["B (hold)", "Show the other picture"],
  ["D", "Denoise the picture at rest, or not"],
  ["G", "Histogram"],
  ["H", "Hide or show the panels"],
  ["[, ]", "Smaller and larger brush"],
  ["Shift+stroke", "Paint a straight line"],
  ["Esc", "Lay the brush down; deselect"],
  ["Shift+click", "Select one more object"],
  ["Double-click, Ctrl+click", "Reset a slider"],
  ["Wheel, drag", "Zoom, pan"],
  ["?", "These keys"],
];

export function Help() {
  const dialog = useRef<HTMLDialogElement>(null);
  const open = model.helpOpen.value;
  useEffect(() => {
    if (open) dialog.current?.showModal();
    else dialog.current?.close();
  }, [open]);
  return (
    <dialog ref={dialog} aria-label="Keys" onClose={() => (model.helpOpen.value = false)}>
      <h2>Keys</h2>
      <dl>
        {KEYS.map(([key, what]) => (
          <>
            <dt>
              <kbd>{key}</kbd>
            </dt>
            <dd>{what}</dd>
          </>
        ))}
      </dl>
      <form method="dialog">
        <button>Close</button>
      </form>
    </dialog>
  );
}
