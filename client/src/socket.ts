// A worker that holds the websocket: pictures come in many small pieces, and taking them off
// the page's own thread keeps them from waiting for its drawing.
import { frameNumber, readFrame } from "./frames";
import { now, type FromWorker, type ToWorker } from "./worker_messages";

const scope = self as unknown as {
  postMessage(message: FromWorker, transfer?: Transferable[]): void;
  onmessage: ((event: MessageEvent<ToWorker>) => void) | null;
};

let socket: WebSocket | null = null;
let frames: Promise<void> = Promise.resolve();

function open(): void {
  const url = new URL("socket", location.href);
  url.protocol = location.protocol === "https:" ? "wss:" : "ws:";
  const opened = new WebSocket(url);
  opened.binaryType = "arraybuffer";
  socket = opened;
  opened.onopen = () => scope.postMessage({ kind: "open" });
  opened.onclose = (event) => {
    if (socket === opened) scope.postMessage({ kind: "close", code: event.code });
  };
  opened.onmessage = (event: MessageEvent<string | ArrayBuffer>) => {
    if (typeof event.data === "string") {
      scope.postMessage({ kind: "text", text: event.data });
      return;
    }
    const data = event.data;
    const arrived = now();
    // In order, though inflating takes its time.
    frames = frames
      .then(() => readFrame(data, arrived))
      .then((frame) => {
        if (frame) scope.postMessage({ kind: "frame", frame }, [frame.pixels.buffer]);
      })
      .catch((error: unknown) => {
        scope.postMessage({ kind: "dropped", frame: frameNumber(data), text: String(error) });
      });
  };
}

scope.onmessage = ({ data }) => {
  if (data.kind === "open") open();
  else if (socket?.readyState === WebSocket.OPEN) socket.send(data.text);
};
