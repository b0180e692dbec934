// The steps of undo, newest last; a click goes there.
import { useEffect, useRef } from "preact/hooks";
import * as model from "../model";

export function History() {
  const list = useRef<HTMLOListElement>(null);
  const labels = model.history.value;
  const position = model.position.value;
  useEffect(() => {
    list.current?.querySelector('[aria-current="step"]')?.scrollIntoView({ block: "nearest" });
  }, [position, labels.length]);
  return (
    <section class="panel history" aria-label="History">
      <h2>
        History
        <span class="spacer" />
        <button disabled={position === 0} title="Undo (Ctrl+Z)" onClick={model.undo}>
          Undo
        </button>
        <button disabled={position === labels.length} title="Redo (Ctrl+Y)" onClick={model.redo}>
          Redo
        </button>
      </h2>
      <ol ref={list}>
        {["As loaded", ...labels].map((text, i) => (
          <li key={i}>
            <button
              class={i > position ? "step undone" : "step"}
              title={text}
              aria-current={i === position ? "step" : undefined}
              onClick={() => model.goTo(i)}
            >
              {text}
            </button>
          </li>
        ))}
      </ol>
    </section>
  );
}
