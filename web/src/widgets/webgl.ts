/** Whether this browser has WebGL 2, and whether a graphics processor draws it. */

let isThere: boolean | null = null;
let isSoftware: boolean | null = null;

/** Whether there is WebGL 2. */
export function hasWebGl(): boolean {
  isThere ??= !drawsInSoftware() || probe(false, () => true) === true;
  return isThere;
}

/** Whether the CPU computes every pixel, so that what moves all the time must not, and the 3D view must draw less. */
export function drawsInSoftware(): boolean {
  isSoftware ??= probe(true, isSoftwareContext) ?? true;
  return isSoftware;
}

/** What a new context tells; null where the browser gives none, throws, or gives none that is `fast`. */
function probe<T>(fast: boolean, ask: (context: WebGL2RenderingContext) => T): T | null {
  let context: WebGL2RenderingContext | null = null;
  try {
    context = document.createElement("canvas").getContext("webgl2", { failIfMajorPerformanceCaveat: fast });
  } catch {
    // An extension that guards against fingerprints may throw: the page, with its stop, must be shown all the same.
  }
  if (context === null) return null;
  const answer = ask(context);
  releaseContext(context);
  return answer;
}

/** Give a context's memory and its share of the graphics processor back now, and not with the next garbage collection. */
export function releaseContext(context: WebGLRenderingContext | WebGL2RenderingContext): void {
  context.getExtension("WEBGL_lose_context")?.loseContext();
}

/** Some browsers see no caveat in a renderer that is software. */
function isSoftwareContext(context: WebGL2RenderingContext): boolean {
  const info = context.getExtension("WEBGL_debug_renderer_info");
  return isSoftwareRenderer(String(context.getParameter(info === null ? context.RENDERER : info.UNMASKED_RENDERER_WEBGL)));
}

export function isSoftwareRenderer(name: string): boolean {
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}
