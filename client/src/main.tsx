// The editor's page.
import { render } from "preact";
import * as model from "./model";
import { listen } from "./keys";
import { Brushes } from "./panels/brushes";
import { Compare } from "./panels/compare";
import { Help } from "./panels/help";
import { History } from "./panels/history";
import { LightList, Lights } from "./panels/lights";
import { Material } from "./panels/material";
import { Mix } from "./panels/mix";
import { Objects } from "./panels/objects";
import { Histogram, StatusBar } from "./panels/statusbar";
import { TopBar } from "./panels/topbar";
import { View } from "./viewer/view";

function App() {
  const tab = model.tab;
  const views = model.welcome.value?.views ?? [];
  return (
    <div class={model.panelsHidden.value ? "app bare" : "app"}>
      <TopBar />
      <aside class="left" aria-label="Scene">
        <Objects />
        <LightList />
        <Compare />
        <History />
      </aside>
      <main>
        <div class="pictures">
          {views.map((view, index) => model.shownViews.value.includes(view.name) && <View key={view.name} data={view} index={index} />)}
          {views.length === 0 && (
            <p class="waiting" role="status">
              {model.link.value === "connecting" ? "Connecting …" : "Waiting for the editor …"}
            </p>
          )}
        </div>
        {model.histogramOpen.value && <Histogram />}
        <Toasts />
      </main>
      <aside class="right" aria-label="Edit">
        <div class="tabs" role="tablist">
          <button role="tab" aria-selected={tab.value === "material"} onClick={() => (tab.value = "material")}>
            Material
          </button>
          <button role="tab" aria-selected={tab.value === "mix"} onClick={() => (tab.value = "mix")}>
            Mix
          </button>
          <button role="tab" aria-selected={tab.value === "lights"} onClick={() => (tab.value = "lights")}>
            Lights
          </button>
          <button role="tab" aria-selected={tab.value === "paint"} onClick={() => (tab.value = "paint")}>
            Paint
          </button>
        </div>
        {{ material: <Material />, mix: <Mix />, lights: <Lights />, paint: <Brushes /> }[tab.value]}
      </aside>
      <StatusBar />
      <Help />
    </div>
  );
}

function Toasts() {
  return (
    <div class="toasts" role="log" aria-live="polite">
      {model.toasts.value.map((toast) => (
        <div key={toast.id} class={`toast ${toast.level}`}>
          <span>{toast.text}</span>
          {toast.offer === "recover" ? (
            <>
              <button
                onClick={() => {
                  model.recover(true);
                  model.dismiss(toast.id);
                }}
              >
                Restore them
              </button>
              <button
                onClick={() => {
                  model.recover(false);
                  model.dismiss(toast.id);
                }}
              >
                Discard
              </button>
            </>
          ) : (
            <button class="small" aria-label="Dismiss" onClick={() => model.dismiss(toast.id)}>
              ×
            </button>
          )}
        </div>
      ))}
    </div>
  );
}

const root = document.getElementById("app");
if (root) {
  render(<App />, root);
  listen();
  model.connect();
}
