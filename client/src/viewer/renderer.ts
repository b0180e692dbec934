// One view's picture in WebGL 2: textures in, tone-mapped pixels out.
import { Kind, type Frame } from "../frames";
import { fragment, VERTEX, type Features } from "./shaders";
import type { RGB } from "../messages";

export interface Look {
  /** Picture pixels to canvas pixels: canvas = origin + zoom · picture. */
  origin: [number, number];
  zoom: number;
  gain: RGB;
  operator: number;
  comparison: number;
  /** Show the denoised picture in place of the noisy one. */
  resting: boolean;
  wipe: number;
  hovered: number;
  selected: number;
  glow: number;
  pixelRatio: number;
}

const SURROUND: RGB = [0.118, 0.118, 0.118];
const GRID_ZOOM = 14;

const UNIFORMS = [
  "picture", "other", "objects", "height", "size", "corner", "extent", "origin", "zoom", "gain", "wipe", "hovered",
  "selected", "glow", "thickness",
] as const;

interface Program {
  program: WebGLProgram;
  at: Record<(typeof UNIFORMS)[number], WebGLUniformLocation | null>;
}

interface Slot {
  texture: WebGLTexture;
  width: number;
  height: number;
  left: number;
  top: number;
}

export class Renderer {
  private readonly gl: WebGL2RenderingContext;
  private readonly programs = new Map<string, Program>();
  private readonly slots: Record<Kind, Slot>;

  /** Throws an Error in words when the browser has no WebGL 2. */
  constructor(private readonly canvas: HTMLCanvasElement) {
    const gl = canvas.getContext("webgl2", {
      alpha: false,
      antialias: false,
      depth: false,
      desynchronized: false,
      preserveDrawingBuffer: false,
    });
    if (!gl) throw new Error("This browser has no WebGL 2, which the picture needs.");
    this.gl = gl;
    this.slots = {
      [Kind.Picture]: slot(gl),
      [Kind.Objects]: slot(gl),
      [Kind.Comparison]: slot(gl),
      [Kind.Resting]: slot(gl),
    };
    gl.clearColor(...SURROUND, 1);
    gl.bindVertexArray(gl.createVertexArray());
    for (const kind of [Kind.Picture, Kind.Objects, Kind.Comparison, Kind.Resting]) {
      this.upload({ kind, view: 0, width: 1, height: 1, frame: 0, revision: 0, left: 0, top: 0, arrived: 0, pixels: new Uint16Array(3) });
    }
  }

  /** Whether there is a picture of that kind. */
  has(kind: Kind): boolean {
    return this.slots[kind].width > 1;
  }

  get size(): [number, number] {
    return [this.slots[Kind.Picture].width, this.slots[Kind.Picture].height];
  }

  upload(frame: Frame): void {
    const { gl } = this;
    const target = this.slots[frame.kind];
    gl.activeTexture(gl.TEXTURE0 + frame.kind);
    gl.bindTexture(gl.TEXTURE_2D, target.texture);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 2);
    target.left = frame.left;
    target.top = frame.top;
    const numbers = frame.kind === Kind.Objects;
    const format = numbers ? gl.RED_INTEGER : gl.RGB;
    const type = numbers ? gl.UNSIGNED_SHORT : gl.HALF_FLOAT;
    if (target.width === frame.width && target.height === frame.height) {
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, frame.width, frame.height, format, type, frame.pixels);
    } else {
      const internal = numbers ? gl.R16UI : gl.RGB16F;
      gl.texImage2D(
        gl.TEXTURE_2D, 0, internal, frame.width, frame.height, 0, format, type,
        numbers ? frame.pixels.subarray(0, frame.width * frame.height) : frame.pixels,
      );
      // Integers cannot be filtered; pictures are, when they are shown smaller than they are.
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, numbers ? gl.NEAREST : gl.LINEAR);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
      target.width = frame.width;
      target.height = frame.height;
    }
  }

  draw(look: Look): void {
    const { gl, canvas } = this;
    const [width, height] = this.size;
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.disable(gl.SCISSOR_TEST);
    gl.clear(gl.COLOR_BUFFER_BIT);

    // Only the picture's own rectangle is shaded.
    const left = Math.max(Math.round(look.origin[0]), 0);
    const top = Math.max(Math.round(look.origin[1]), 0);
    const right = Math.min(Math.round(look.origin[0] + width * look.zoom), canvas.width);
    const bottom = Math.min(Math.round(look.origin[1] + height * look.zoom), canvas.height);
    if (right <= left || bottom <= top) return;
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(left, canvas.height - bottom, right - left, bottom - top);

    const selected = look.glow > 0 ? look.selected : 0;
    const numbered = this.slots[Kind.Objects].width === width;
    const { program, at } = this.programFor({
      operator: look.operator,
      comparison: this.comparable ? look.comparison : 0,
      outlines: numbered && (look.hovered > 0 || selected > 0),
      grid: look.zoom >= GRID_ZOOM,
      smaller: look.zoom < 1,
    });
    gl.useProgram(program);
    gl.uniform1i(at.picture, look.resting && look.comparison === 0 ? Kind.Resting : Kind.Picture);
    gl.uniform1f(at.height, canvas.height);
    gl.uniform2f(at.size, width, height);
    const other = this.slots[Kind.Comparison];
    gl.uniform2f(at.corner, other.left, other.top);
    gl.uniform2f(at.extent, other.width, other.height);
    gl.uniform2f(at.origin, ...look.origin);
    gl.uniform1f(at.zoom, look.zoom);
    gl.uniform3fv(at.gain, look.gain);
    gl.uniform1f(at.wipe, look.wipe);
    gl.uniform1i(at.hovered, look.hovered);
    gl.uniform1i(at.selected, selected);
    gl.uniform1f(at.glow, look.glow);
    gl.uniform1f(at.thickness, 1.5 * look.pixelRatio);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  private programFor(features: Features): Program {
    const key = JSON.stringify(features);
    const known = this.programs.get(key);
    if (known) return known;
    const { gl } = this;
    const program = link(gl, fragment(features));
    const at = Object.fromEntries(
      UNIFORMS.map((name) => [name, gl.getUniformLocation(program, name)]),
    ) as Program["at"];
    gl.useProgram(program);
    gl.uniform1i(at.objects, Kind.Objects);
    gl.uniform1i(at.other, Kind.Comparison);
    const made = { program, at };
    this.programs.set(key, made);
    return made;
  }

  private get comparable(): boolean {
    return this.has(Kind.Comparison);
  }

  /** Left and right edge of what is compared, in picture pixels. */
  get compared(): [number, number] {
    const { left, width } = this.slots[Kind.Comparison];
    return this.comparable ? [left, left + width] : [0, this.size[0]];
  }

  /** The whole picture as the look shows it, `width` pixels wide, as a canvas. */
  snapshot(look: Look, width: number): HTMLCanvasElement {
    const [w, h] = this.size;
    const scale = Math.min(width / w, 1);
    const target = document.createElement("canvas");
    target.width = Math.max(Math.round(w * scale), 1);
    target.height = Math.max(Math.round(h * scale), 1);
    const before: [number, number] = [this.canvas.width, this.canvas.height];
    this.canvas.width = w;
    this.canvas.height = h;
    this.draw({ ...look, origin: [0, 0], zoom: 1, comparison: 0, resting: false, hovered: 0, glow: 0 });
    target.getContext("2d")?.drawImage(this.canvas, 0, 0, target.width, target.height);
    [this.canvas.width, this.canvas.height] = before;
    this.draw(look);
    return target;
  }

  close(): void {
    this.gl.getExtension("WEBGL_lose_context")?.loseContext();
  }
}

function slot(gl: WebGL2RenderingContext): Slot {
  const texture = gl.createTexture();
  if (!texture) throw new Error("The graphics card refused a texture.");
  return { texture, width: 0, height: 0, left: 0, top: 0 };
}

function link(gl: WebGL2RenderingContext, source: string): WebGLProgram {
  const program = gl.createProgram();
  for (const [type, text] of [
    [gl.VERTEX_SHADER, VERTEX],
    [gl.FRAGMENT_SHADER, source],
  ] as const) {
    const shader = gl.createShader(type);
    if (!shader) throw new Error("The graphics card refused a shader.");
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) {
      throw new Error(`The viewer's shader did not compile: ${gl.getShaderInfoLog(shader)}`);
    }
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
    throw new Error(`The viewer's shader did not link: ${gl.getProgramInfoLog(program)}`);
  }
  return program;
}
