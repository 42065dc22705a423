/** The aurora's picture: layers of noise that drift through one another, drawn by one triangle in plain WebGL. */
import { drawsInSoftware, releaseContext } from "@/widgets/webgl";
import type { Look } from "./mood";

const VERTEX = "attribute vec2 corner; void main() { gl_Position = vec4(corner, 0.0, 1.0); }";

const FRAGMENT = `
precision mediump float;
uniform vec2 size;
uniform float time, stop, lost, gain;

float hash(vec2 cell) {
  cell = fract(cell * vec2(127.34, 311.71));
  cell += dot(cell, cell + 34.23);
  return fract(cell.x * cell.y);
}

float noise(vec2 at) {
  vec2 cell = floor(at), within = fract(at);
  within = within * within * (3.0 - 2.0 * within);
  return mix(
    mix(hash(cell), hash(cell + vec2(1.0, 0.0)), within.x),
    mix(hash(cell + vec2(0.0, 1.0)), hash(cell + 1.0), within.x),
    within.y);
}

float layers(vec2 at) {
  float sum = 0.0, share = 0.55;
  for (int layer = 0; layer < 4; layer++) {
    sum += share * noise(at);
    at = at * 2.03 + 7.3;
    share *= 0.5;
  }
  return sum;
}

void main() {
  vec2 at = gl_FragCoord.xy / size.y;
  vec2 drift = vec2(layers(at * 1.4 + time), layers(at * 1.4 - time + 4.2));
  // Curtains: long from left to right, bent by the drift.
  float curtain = layers(at * vec2(0.9, 2.3) + 1.8 * drift + vec2(time * 0.5, 0.0));
  float band = smoothstep(0.36, 0.92, curtain);
  float ray = 0.82 + 0.18 * noise(vec2(at.x * 9.0 + 3.0 * drift.x, time * 3.0));
  vec3 lime = vec3(0.42, 0.62, 0.06);
  vec3 cyan = vec3(0.02, 0.42, 0.47);
  vec3 color = mix(cyan, lime, smoothstep(0.25, 0.75, drift.x + 0.25 * (at.x - 0.8)));
  color = mix(color, vec3(0.62, 0.03, 0.04), stop);
  color = mix(color, vec3(dot(color, vec3(0.3, 0.5, 0.2))) * 0.55, lost);
  // A grain of less than one step of a color keeps wide gradients from showing bands.
  float grain = (hash(gl_FragCoord.xy + fract(time)) - 0.5) / 200.0;
  gl_FragColor = vec4(vec3(0.036, 0.055, 0.044) + color * band * ray * gain + grain, 1.0);
}`;

export interface Shader {
  draw: (look: Look, time: number) => void;
  resize: (width: number, height: number) => void;
  /** Nothing can be drawn afterwards. */
  release: () => void;
}

/**
 * The shader on a canvas; null without a graphics processor, or where the browser refuses it. The CPU would compute every pixel,
 * and every layer above it anew with each frame, which leaves the page a few frames a second.
 */
export function createShader(canvas: HTMLCanvasElement): Shader | null {
  if (drawsInSoftware()) return null;
  // Asked again here: a browser whose graphics process ended goes on in software.
  const gl = canvas.getContext("webgl", { antialias: false, alpha: false, depth: false, powerPreference: "low-power", failIfMajorPerformanceCaveat: true });
  if (gl === null) return null;
  const program = link(gl);
  if (program === null) return null;
  gl.useProgram(program);
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([-1, -1, 3, -1, -1, 3]), gl.STATIC_DRAW);
  const corner = gl.getAttribLocation(program, "corner");
  gl.enableVertexAttribArray(corner);
  gl.vertexAttribPointer(corner, 2, gl.FLOAT, false, 0, 0);
  const place = (name: string) => gl.getUniformLocation(program, name);
  const [size, time, stop, lost, gain] = [place("size"), place("time"), place("stop"), place("lost"), place("gain")];
  return {
    release: () => releaseContext(gl),
    resize: (width, height) => {
      canvas.width = width;
      canvas.height = height;
      gl.viewport(0, 0, width, height);
    },
    draw: (look, seconds) => {
      gl.uniform2f(size, canvas.width, canvas.height);
      gl.uniform1f(time, seconds);
      gl.uniform1f(stop, look.stop);
      gl.uniform1f(lost, look.lost);
      gl.uniform1f(gain, look.gain);
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    },
  };
}

function link(gl: WebGLRenderingContext): WebGLProgram | null {
  const program = gl.createProgram();
  const compiled = [
    compile(gl, gl.VERTEX_SHADER, VERTEX),
    compile(gl, gl.FRAGMENT_SHADER, FRAGMENT),
  ];
  for (const shader of compiled) {
    if (shader === null) return null;
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  return gl.getProgramParameter(program, gl.LINK_STATUS) ? program : null;
}

function compile(gl: WebGLRenderingContext, kind: number, source: string): WebGLShader | null {
  const shader = gl.createShader(kind);
  if (shader === null) return null;
  gl.shaderSource(shader, source);
  gl.compileShader(shader);
  return gl.getShaderParameter(shader, gl.COMPILE_STATUS) ? shader : null;
}
