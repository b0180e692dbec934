// The list of objects, searchable; hovering shows one in the picture.
import { useSignal } from "@preact/signals";
import * as model from "../model";

export function Objects() {
  const query = useSignal("");
  const wanted = query.value.trim().toLowerCase();
  const items = model.objects.value.filter(
    (item) => !wanted || [item.id, ...item.layers.map((l) => `${l.name} ${l.model}`)].join(" ").toLowerCase().includes(wanted),
  );
  return (
    <section class="panel objects" aria-label="Objects">
      <h2>
        Objects <small>{model.objects.value.length}</small>
      </h2>
      <input
        class="search"
        type="search"
        placeholder="Search objects and layers"
        aria-label="Search objects"
        value={query.value}
        onInput={(event) => (query.value = event.currentTarget.value)}
      />
      <ul role="listbox" aria-label="Objects" aria-multiselectable="true">
        {items.map((item) => {
          const chosen = model.selected.value.includes(item.id);
          const values = model.materials.value[item.id];
          return (
            <li key={item.id} role="none">
              <button
                role="option"
                class={["object", chosen && "chosen", !item.editable && "fixed", model.hovered.value === item.id && "hovered"]
                  .filter(Boolean)
                  .join(" ")}
                aria-selected={chosen}
                aria-disabled={!item.editable}
                title={item.editable ? item.layers.map((l) => `${l.name}: ${l.model}`).join("\n") : `Not editable: ${item.reason}`}
                onMouseEnter={() => (model.hovered.value = item.id)}
                onMouseLeave={() => (model.hovered.value = "")}
                onClick={(event) => {
                  if (!item.editable) return;
                  if (!event.shiftKey) model.select([item.id]);
                  else if (chosen) model.select(model.selected.value.filter((id) => id !== item.id));
                  else model.select([...model.selected.value, item.id]);
                }}
              >
                <span class="name">{item.id}</span>
                {values?.changed && <span class="dot" title="Edited" aria-label="edited" />}
                {!item.editable && <span class="note">fixed</span>}
              </button>
            </li>
          );
        })}
        {items.length === 0 && <li class="empty">{wanted ? `Nothing matches “${query.value}”.` : "No objects."}</li>}
      </ul>
    </section>
  );
}
