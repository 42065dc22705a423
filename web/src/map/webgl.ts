let answer: boolean | null = null;

/** Whether this browser draws with WebGL 2. */
export function hasWebGl(): boolean {
  if (answer === null) {
    const context = document.createElement("canvas").getContext("webgl2");
    answer = context !== null;
    context?.getExtension("WEBGL_lose_context")?.loseContext();
  }
  return answer;
}
