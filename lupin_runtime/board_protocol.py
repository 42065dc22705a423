"""Telemetrix, the serial protocol of the motor board: frames, the requests of a probe, and what the answers say.

A frame is one byte with its length, then an id and data; there is no checksum and no start byte. Frames, ids and the limits
below are those of the vendor's firmware and driver: https://github.com/mirte-robot/Telemetrix4RpiPico (README.md and
include/message_types.hpp) and https://github.com/ArendJan/tmx-cpp (TMX::check_port).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum

# Requests, and the reports that answer them.
LOOP_BACK, FIRMWARE, UNIQUE_ID = 0, 5, 6
ENCODER = 14  # a report: the pin of an encoder, and its steps since the last one as a signed byte
# Frame lengths by the id of the report; None if they vary. The firmware sends no other reports.
REPORT_LENGTHS: dict[int, tuple[int, ...] | None] = {
    LOOP_BACK: (2,),
    2: (3,),  # digital pin
    3: (4,),  # analog pin
    FIRMWARE: (3,),
    UNIQUE_ID: (9,),
    7: None,  # servo unavailable
    8: None,  # I2C was written
    9: (4,),  # I2C could not be read
    10: None,  # I2C was read
    11: (4, 5),  # sonar
    12: (6,),  # humidity and temperature
    13: None,  # SPI
    ENCODER: (3,),
    20: None,  # sensor
    21: None,  # kinds of sensors
    32: (3,),  # answer to a ping
    33: None,  # kinds of modules
    34: None,  # module
    35: (2,),  # saved id
    36: (2,),  # saved id, after a change
    37: None,  # feature
    99: (4,),  # debug
}
MAX_FRAME = 63  # bytes after the length; the firmware's longest report buffer has 64
# The vendor's driver of MIRTE OS 0.2 asks at every start which features the firmware has. Older firmware has no such request,
# and jumps to a random address. So may the first builds of 1.3, which the version does not tell: a probe must not ask this.
OLDEST_FIRMWARE = (1, 3)
ANSWER_LIMIT_S = 2.0  # so long the vendor's driver waits for the firmware's version before it gives up the port
MAX_SKIPPED = 0.1  # share of bytes outside of reports, above which they are not those of Telemetrix
_TOKENS = (0x5A, 0xA5)


class FrameError(ValueError):
    """A frame is empty or too long."""


@dataclass(frozen=True)
class Report:
    """One frame of the board."""

    id: int
    data: bytes


def encode(id: int, data: bytes = b"") -> bytes:
    """Return the frame of a request or report. Raises FrameError."""
    if not 0 <= id <= 255 or len(data) >= MAX_FRAME:
        raise FrameError(f"expected an id of one byte and at most {MAX_FRAME - 1} bytes of data, found {id} and {len(data)}")
    return bytes((len(data) + 1, id)) + data


# What a probe sends. These change nothing on the board: no pin, no report, no watchdog. A ping would start the watchdog, which
# resets the board 5 s later.
PROBE_REQUESTS = (
    encode(LOOP_BACK, bytes(_TOKENS[:1])),
    encode(FIRMWARE),
    encode(UNIQUE_ID),
    encode(LOOP_BACK, bytes(_TOKENS[1:])),
)


def decode(stream: bytes) -> tuple[tuple[Report, ...], int]:
    """Return the reports in a stream, and how many bytes belong to none.

    Where no report begins, one byte is skipped: a stream may begin in the middle of a frame, and a frame may be damaged.
    """
    found = [report for _, report in _iterate_reports(stream)]
    return tuple(found), len(stream) - sum(len(report.data) + 2 for report in found)


def _iterate_reports(stream: bytes) -> Iterator[tuple[int, Report]]:
    """Yield each report, with the position behind it."""
    position = 0
    while position + 1 < len(stream):
        length = stream[position]
        end = position + 1 + length
        if 2 <= length <= MAX_FRAME and end <= len(stream) and _is_report(stream[position + 1], length):
            yield end, Report(stream[position + 1], stream[position + 2 : end])
            position = end
        else:
            position += 1


def _is_report(id: int, length: int) -> bool:
    if id not in REPORT_LENGTHS:
        return False
    lengths = REPORT_LENGTHS[id]
    return lengths is None or length in lengths


@dataclass(frozen=True)
class Chunk:
    """Bytes that arrived together, and how long after the requests were sent; negative before they were."""

    after_s: float
    data: bytes


class Answer(str, Enum):
    """How a board answers the requests of a probe."""

    HEALTHY = "healthy"
    SILENT = "silent"  # no answer: at most reports of its own accord
    LATE = "late"  # too late for the vendor's driver
    OLD = "old"  # a firmware that the vendor's driver does not support
    FOREIGN = "foreign"  # what arrives are not the answers of Telemetrix: another program, or a damaged line


@dataclass(frozen=True)
class Examination:
    """The judged answers of a board."""

    answer: Answer
    firmware: tuple[int, int] | None = None
    unique_id: str = ""
    answered_s: float | None = None  # when the firmware's version had arrived
    encoder_reports: int = 0
    received: int = 0  # bytes
    skipped: int = 0  # bytes that belong to no report

    @property
    def version(self) -> str:
        """The firmware's version; empty if it is not known."""
        return ".".join(map(str, self.firmware)) if self.firmware is not None else ""


def examine(chunks: Sequence[Chunk]) -> Examination:
    """Judge what arrived on the port."""
    stream = b"".join(chunk.data for chunk in chunks)
    reports, skipped = decode(stream)
    by_id = {report.id: report.data for report in reports}
    echoed = {report.data[0] for report in reports if report.id == LOOP_BACK}
    version = by_id.get(FIRMWARE)
    firmware = (version[0], version[1]) if version is not None else None
    answered_s = _arrival_s(chunks)
    if firmware is None and not echoed:
        # A board in use sends reports all the time, and the first one may be cut. Text and noise contain reports by chance.
        answer = Answer.FOREIGN if skipped > MAX_SKIPPED * len(stream) else Answer.SILENT
    elif firmware is None or answered_s is None or not echoed.issuperset(_TOKENS):
        answer = Answer.FOREIGN
    elif answered_s > ANSWER_LIMIT_S:
        answer = Answer.LATE
    elif firmware[0] != OLDEST_FIRMWARE[0] or firmware < OLDEST_FIRMWARE:
        answer = Answer.OLD
    else:
        answer = Answer.HEALTHY
    return Examination(
        answer=answer,
        firmware=firmware,
        unique_id=by_id.get(UNIQUE_ID, b"").hex(),
        answered_s=answered_s,
        encoder_reports=sum(report.id == ENCODER for report in reports),
        received=len(stream),
        skipped=skipped,
    )


def _arrival_s(chunks: Sequence[Chunk]) -> float | None:
    """Return when the report of the firmware's version was complete; None if there is none."""
    stream = b"".join(chunk.data for chunk in chunks)
    end = next((end for end, report in _iterate_reports(stream) if report.id == FIRMWARE), None)
    position = 0
    for chunk in chunks:
        position += len(chunk.data)
        if end is not None and position >= end:
            return chunk.after_s
    return None
