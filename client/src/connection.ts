// The websocket: it reconnects by itself and sends drags once per displayed frame.
import { frameNumber, readFrame, type Frame } from "./frames";
import { VERSION, type FromServer, type ToServer } from "./messages";

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
  private socket: WebSocket | null = null;
  private seq = 0;
  private wait = 250;
  private latest = new Map<string, ToServer>();
  private scheduled = false;
  private frames: Promise<void> = Promise.resolve();
  private readonly client = Math.random().toString(36).slice(2, 12);

  constructor(private readonly handlers: Handlers) {}

  open(): void {
    this.handlers.onLink("connecting");
    const url = new URL("socket", location.href);
    url.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(url);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    this.seq = 0;
    socket.onopen = () => {
      this.wait = 250;
      this.send({ type: "Hello", version: VERSION, client: this.client });
      this.handlers.onOpen();
    };
    socket.onmessage = (event: MessageEvent<string | ArrayBuffer>) => {
      if (typeof event.data === "string") {
        const message = JSON.parse(event.data) as FromServer;
        if (message.type === "Welcome") this.handlers.onLink("open");
        this.handlers.onMessage(message);
        return;
      }
      const data = event.data;
      const arrived = performance.now();
      // In order, though inflating takes its time.
      this.frames = this.frames
        .then(() => readFrame(data, arrived))
        .then((frame) => {
          if (frame) this.handlers.onFrame(frame);
        })
        .catch((error: unknown) => {
          console.error("frame dropped:", error);
          // The server waits for word of it before it sends the next.
          this.send({ type: "Shown", frame: frameNumber(data), held: 0 });
        });
    };
    socket.onclose = (event) => {
      if (this.socket !== socket) return;
      this.socket = null;
      this.latest.clear();
      if (event.code === 4409) {
        this.handlers.onLink("outdated");
        return;
      }
      this.handlers.onLink("lost");
      setTimeout(() => this.open(), this.wait);
      this.wait = Math.min(this.wait * 2, LONGEST_WAIT);
    };
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
    if (this.socket?.readyState !== WebSocket.OPEN) return;
    this.seq += 1;
    this.socket.send(JSON.stringify({ ...message, seq: this.seq }));
  }
}
