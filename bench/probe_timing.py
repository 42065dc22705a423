"""`python bench/probe_timing.py FILE doctor ...`: run `lupin` and write the seconds of its slowest probe to FILE."""

from __future__ import annotations

import atexit
import sys
from pathlib import Path


def main() -> None:
    """Time every probe of the `lupin` command in `sys.argv`, and write the slowest one's seconds."""
    from lupin_cli.connection.batch_protocol import FrameReader

    slowest_s = 0.0
    outputs = FrameReader.outputs

    def timed_outputs(self: FrameReader, why_cut: str) -> object:
        nonlocal slowest_s
        found = outputs(self, why_cut)
        slowest_s = max([slowest_s, *(output.duration_s for output in found.values())])
        return found

    # lupin has no option that prints the durations of probes, so their reader is wrapped.
    FrameReader.outputs = timed_outputs  # type: ignore[assignment,method-assign]
    path = Path(sys.argv.pop(1))
    atexit.register(lambda: path.write_text(str(slowest_s)))
    from lupin_cli.app import main as lupin

    lupin()


if __name__ == "__main__":
    main()
