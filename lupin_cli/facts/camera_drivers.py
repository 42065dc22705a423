"""What the camera service last did with the driver of each camera."""

from __future__ import annotations

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, parse_sections
from lupin_runtime.cameras.driver_state import STATE_FOLDER, DriverState
from lupin_runtime.json_text import parse_json

PROBE = (
    PRELUDE
    + f"""for f in {STATE_FOLDER}/*.json; do
  [ -r "$f" ] && echo "@@ camera $(basename "$f" .json)" && head -c 4096 "$f" && echo
done
echo '@@ end'
"""
)


def parse(output: Output) -> dict[str, DriverState]:
    """Parse the output of PROBE: the states by camera (body, gripper); empty if the service does not run. Raises ValueError."""
    sections = parse_sections(output)
    sections.lines("end")
    return {section.argument: _state(section.text) for section in sections.all("camera")}


def _state(text: str) -> DriverState:
    try:
        read = parse_json(text)
        return DriverState(str(read["state"]), str(read["text"]), int(read["ends"]))
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"expected a driver's state, found {text[:80]!r}") from error


CAMERA_DRIVERS = Fact("camera-drivers", PROBE, parse)
