// Binary messages: pictures and the objects under their pixels (see FrameHeader).
import { FRAME_MAGIC } from "./messages";

export const enum Kind {
  Picture = 0,
  Objects = 1,
  Comparison = 2,
  /** The picture denoised: for the eye, never for what is saved or compared. */
  Resting = 3,
}

export interface Frame {
  kind: Kind;
  view: number;
  width: number;
  height: number;
  frame: number;
  revision: number;
  /** The view's pixel that the first one lies on. */
  left: number;
  top: number;
  /** When it arrived, by the clock `now` of worker_messages.ts. */
  arrived: number;
  /** Float16 bit patterns [height, width, 3], or object numbers [height, width]. */
  pixels: Uint16Array;
}

const HEADER_BYTES = 40;

/** The number of the frame that a message holds. */
export function frameNumber(message: ArrayBuffer): number {
  return message.byteLength < HEADER_BYTES ? 0 : new DataView(message).getUint32(24, true);
}

/** Read a message; `null` for one that is no frame. */
export async function readFrame(message: ArrayBuffer, arrived: number): Promise<Frame | null> {
  if (message.byteLength < HEADER_BYTES) return null;
  const head = new Uint32Array(message, 0, HEADER_BYTES / 4);
  const [magic, kind, view, codec, width, height, frame, revision, left, top] = head as unknown as [
    number, number, number, number, number, number, number, number, number, number,
  ];
  if (magic !== FRAME_MAGIC) return null;
  const channels = kind === Kind.Objects ? 1 : 3;
  const pixels =
    codec === 0
      ? new Uint16Array(message, HEADER_BYTES, width * height * channels)
      : await inflate(new Uint8Array(message, HEADER_BYTES), width, height, channels);
  return { kind, view, width, height, frame, revision, left, top, arrived, pixels };
}

async function inflate(
  body: Uint8Array<ArrayBuffer>,
  width: number,
  height: number,
  channels: number,
): Promise<Uint16Array> {
  const stream = new Blob([body]).stream().pipeThrough(new DecompressionStream("deflate"));
  const planes = new Uint8Array(await new Response(stream).arrayBuffer());
  const count = width * height * channels;
  const result = new Uint16Array(count);
  const row = width * channels;
  for (let i = 0; i < count; i++) {
    const difference = (planes[i] ?? 0) | ((planes[count + i] ?? 0) << 8);
    result[i] = i % row < channels ? difference : (result[i - channels] ?? 0) + difference;
  }
  return result;
}
