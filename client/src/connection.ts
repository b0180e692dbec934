// The connection to the server: it reconnects by itself and sends drags once per displayed frame.
import type { Frame } from "./frames";
import { VERSION, type FromServer, type ToServer } from "./messages";
import type { FromWorker, ToWorker } from "./worker_messages";

export type Link = "connecting" | "open" | "lost" | "outdated";

export interface Handlers {
  onMessage(message: FromServer): void;
  onFrame(frame: Frame): void;
  onLink(link: Link): void;
  /** What to say anew after each (re)connection. */
  onOpen(): void;
}

const LONGEST_WAIT = 4000;

export class Connection {
  private readonly worker: Worker;
  private connected = false;
  private seq = 0;
  private wait = 250;
  private latest = new Map<string, ToServer>();
  private scheduled = false;
  private readonly client = Math.random().toString(36).slice(2, 12);

  constructor(private readonly handlers: Handlers) {
    this.worker = new Worker(new URL("socket.js", document.baseURI), { type: "module" });
    this.worker.onmessage = ({ data }: MessageEvent<FromWorker>) => this.take(data);
  }

  open(): void {
    this.handlers.onLink("connecting");
    this.post({ kind: "open" });
  }

  private take(message: FromWorker): void {
    switch (message.kind) {
      case "open":
        this.connected = true;
        this.wait = 250;
        this.seq = 0;
        this.send({ type: "Hello", version: VERSION, client: this.client });
        this.handlers.onOpen();
        break;
      case "text": {
        const words = JSON.parse(message.text) as FromServer;
        if (words.type === "Welcome") this.handlers.onLink("open");
        this.handlers.onMessage(words);
        break;
      }
      case "frame":
        this.handlers.onFrame(message.frame);
        break;
      case "dropped":
        console.error("frame dropped:", message.text);
        // The server waits for word of it before it sends the next.
        this.send({ type: "Shown", frame: message.frame, held: 0 });
        break;
      case "close":
        this.connected = false;
        this.latest.clear();
        if (message.code === 4409) {
          this.handlers.onLink("outdated");
          return;
        }
        this.handlers.onLink("lost");
        setTimeout(() => this.open(), this.wait);
        this.wait = Math.min(this.wait * 2, LONGEST_WAIT);
    }
  }

  private post(message: ToWorker): void {
    this.worker.postMessage(message);
  }

  /** Send now, after whatever waits for the next displayed frame. */
  send(message: ToServer): void {
    this.flush();
    this.write(message);
  }

  /** A drag's value: the first of a displayed frame goes out at once, the newest of the others
   * at its end. */
  sendLatest(key: string, message: ToServer): void {
    this.latest.set(key, message);
    if (this.scheduled) return;
    this.scheduled = true;
    this.flush();
    requestAnimationFrame(() => {
      this.scheduled = false;
      this.flush();
    });
  }

  private flush(): void {
    const waiting = [...this.latest.values()];
    this.latest.clear();
    for (const message of waiting) this.write(message);
  }

  private write(message: ToServer): void {
    if (!this.connected) return;
    this.seq += 1;
    this.post({ kind: "send", text: JSON.stringify({ ...message, seq: this.seq }) });
  }
}
