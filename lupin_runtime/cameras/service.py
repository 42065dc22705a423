"""The robot's camera service, run by systemd: `python -m lupin_runtime.cameras.service`.

It runs the vendor's drivers as configured in `/etc/lupin/cameras.yaml`, and the video server.
"""

from __future__ import annotations

import sys

from lupin_runtime.atomic_file import MalformedFile
from lupin_runtime.cameras.configuration import read_configuration
from lupin_runtime.ending import exit_with
from lupin_runtime.stack.options import ROBOT_CAMERAS, Options
from lupin_runtime.stack.service import serve


def main() -> int:
    """Run until a signal arrives; returns the exit status, 1 if the configuration cannot be read."""
    try:
        read_configuration()
    except (MalformedFile, OSError) as error:
        print(f"error: {error}", file=sys.stderr, flush=True)  # the doctor finds the line by the word "error"
        return 1
    return serve(Options(target=ROBOT_CAMERAS))


if __name__ == "__main__":
    exit_with(main())
