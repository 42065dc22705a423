"""`python bench/probe_timing.py FILE doctor ...`: run `lupin doctor ...`, and write how long its slowest probe took to FILE."""

from __future__ import annotations

import atexit
import sys
from pathlib import Path


def main() -> None:
    """Run the `lupin` command in `sys.argv`, and write the longest duration of its probes, in seconds, at exit."""
    from lupin_cli.connection.batch_protocol import FrameReader

    slowest_s = 0.0
    original_outputs = FrameReader.outputs

    def timed_outputs(self: FrameReader, why_cut: str) -> object:
        nonlocal slowest_s
        found = original_outputs(self, why_cut)
        slowest_s = max([slowest_s, *(output.duration_s for output in found.values())])
        return found

    # lupin has no option that prints the durations of probes, so the method that returns them is wrapped.
    FrameReader.outputs = timed_outputs  # type: ignore[assignment,method-assign]
    path = Path(sys.argv.pop(1))
    atexit.register(lambda: path.write_text(str(slowest_s)))
    from lupin_cli.app import main as lupin

    lupin()


if __name__ == "__main__":
    main()
