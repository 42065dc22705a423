/** What this browser draws with. */

interface Answer {
  isThere: boolean;
  isSoftware: boolean;
}

let answer: Answer | null = null;

function look(): Answer {
  if (answer !== null) return answer;
  const context = document.createElement("canvas").getContext("webgl2");
  if (context === null) return (answer = { isThere: false, isSoftware: true });
  const info = context.getExtension("WEBGL_debug_renderer_info");
  const renderer = String(context.getParameter(info === null ? context.RENDERER : info.UNMASKED_RENDERER_WEBGL));
  context.getExtension("WEBGL_lose_context")?.loseContext();
  return (answer = { isThere: true, isSoftware: isSoftwareRenderer(renderer) });
}

/** Whether there is WebGL 2. */
export function hasWebGl(): boolean {
  return look().isThere;
}

/** Whether the processor computes every pixel, so that the view in 3D must spare it. */
export function drawsInSoftware(): boolean {
  return look().isSoftware;
}

export function isSoftwareRenderer(name: string): boolean {
  return /swiftshader|llvmpipe|software|basic render/i.test(name);
}
