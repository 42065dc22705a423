/** `read` that returns the value of before while the content is the same, so that nothing is built anew for it. */
export function keepWhileSame<Value>(read: () => Value): () => Value {
  let kept: { value: Value; content: string } | null = null;
  return () => {
    const value = read();
    const content = JSON.stringify(value);
    if (kept?.content !== content) kept = { value, content };
    return kept.value;
  };
}
