/** Whether this browser has WebGL 2, and whether a graphics processor draws it. */

interface Answer {
  isThere: boolean;
  isSoftware: boolean;
}

let answer: Answer | null = null;

function look(): Answer {
  if (answer !== null) return answer;
  const context = document.createElement("canvas").getContext("webgl2");
  if (context === null) return (answer = { isThere: false, isSoftware: true });
  answer = { isThere: true, isSoftware: isSoftwareContext(context) };
  context.getExtension("WEBGL_lose_context")?.loseContext();
  return answer;
}

/** Whether there is WebGL 2. */
export function hasWebGl(): boolean {
  return look().isThere;
}

/** Whether the CPU computes every pixel, so that the 3D view must draw less. */
export function drawsInSoftware(): boolean {
  return look().isSoftware;
}

/** Whether the CPU computes what a context draws. */
export function isSoftwareContext(context: WebGLRenderingContext): boolean {
  const info = context.getExtension("WEBGL_debug_renderer_info");
  return isSoftwareRenderer(String(context.getParameter(info === null ? context.RENDERER : info.UNMASKED_RENDERER_WEBGL)));
}

export function isSoftwareRenderer(name: string): boolean {
  return /swiftshader|llvmpipe|software|basic render/i.test(name);
}
