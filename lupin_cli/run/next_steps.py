"""What an operator can do with a run that is ready: the commands to type."""

from __future__ import annotations

from lupin_runtime.stack.runs import Run, live_runs


def next_steps(run: Run, *, foreground: bool) -> list[str]:
    """Return one line for each command; the run is named if it is not the only one that is up."""
    named = f" --run {run.id}" if any(other.id != run.id for other in live_runs()) else ""
    steps = [
        ("join its graph from this shell", f'eval "$(lupin env{named})"'),
        ("follow it", f"lupin status --watch{named}"),
        ("read its logs", f"lupin logs -f{named}"),
        ("end it", "Ctrl-C" if foreground else f"lupin down{named}"),
    ]
    if foreground:
        steps[0] = ("join its graph from another shell", steps[0][1])
    width = max(len(text) for text, _ in steps)
    return [f"  {text:{width}}  {command}" for text, command in steps]
