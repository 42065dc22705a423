"""The protocol of the motor board: frames survive any surroundings, and answers are judged by what arrived when."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.board_protocol import (
    ENCODER,
    FIRMWARE,
    LOOP_BACK,
    MAX_FRAME,
    PROBE_REQUESTS,
    REPORT_LENGTHS,
    UNIQUE_ID,
    Answer,
    Chunk,
    FrameError,
    Report,
    decode,
    encode,
    examine,
)

ECHOES = (encode(LOOP_BACK, b"\x5a"), encode(LOOP_BACK, b"\xa5"))
ID = encode(UNIQUE_ID, bytes(range(8)))
# Requests that set a pin, a servo or a motor, reset the board, or start the watchdog that does.
CHANGING = {*range(1, 5), *range(7, 32), 32, 33, 34, 36, 38}


def answers(version: bytes = b"\x01\x03", *, after_s: float = 0.01) -> tuple[Chunk, ...]:
    return tuple(Chunk(after_s, frame) for frame in (ECHOES[0], encode(FIRMWARE, version), ID, ECHOES[1]))


@st.composite
def reports(draw: st.DrawFn) -> Report:
    id = draw(st.sampled_from(sorted(REPORT_LENGTHS)))
    lengths = REPORT_LENGTHS[id]
    size = draw(st.integers(1, MAX_FRAME - 1)) if lengths is None else draw(st.sampled_from(lengths)) - 1
    return Report(id, draw(st.binary(min_size=size, max_size=size)))


@given(st.lists(reports(), max_size=20))
def test_encoded_reports_are_decoded_as_they_were(sent: list[Report]) -> None:
    assert decode(b"".join(encode(report.id, report.data) for report in sent)) == (tuple(sent), 0)


@given(st.binary(max_size=400))
def test_every_byte_of_garbage_is_in_a_report_or_skipped(stream: bytes) -> None:
    found, skipped = decode(stream)
    assert sum(len(report.data) + 2 for report in found) + skipped == len(stream)


@given(st.lists(st.tuples(st.floats(-1, 5), st.binary(max_size=60)), max_size=12))
def test_garbage_is_always_judged(chunks: list[tuple[float, bytes]]) -> None:
    found = examine([Chunk(after_s, data) for after_s, data in chunks])
    assert found.received == sum(len(data) for _, data in chunks) and 0 <= found.skipped <= found.received


@given(st.lists(st.binary(min_size=1, max_size=7), min_size=1, max_size=5), st.binary(max_size=30))
def test_report_is_found_wherever_the_stream_is_cut(pieces: list[bytes], before: bytes) -> None:
    stream = bytes(len(before)) + b"".join(frame.data for frame in answers())
    cuts = [len(piece) for piece in pieces]
    chunks: list[Chunk] = []
    while stream:
        size = cuts[len(chunks) % len(cuts)]
        chunks.append(Chunk(0.1, stream[:size]))
        stream = stream[size:]
    assert examine(chunks).firmware == (1, 3)


@given(st.integers(-5, 300), st.binary(max_size=100))
def test_frame_fits_the_protocol_or_is_refused(id: int, data: bytes) -> None:
    if 0 <= id <= 255 and len(data) < MAX_FRAME:
        assert encode(id, data)[:2] == bytes((len(data) + 1, id))
    else:
        with pytest.raises(FrameError, match="expected an id of one byte"):
            encode(id, data)


def test_probe_sends_only_requests_that_change_nothing() -> None:
    assert not {frame[1] for frame in PROBE_REQUESTS} & CHANGING
    assert all(frame[0] == len(frame) - 1 for frame in PROBE_REQUESTS)


@pytest.mark.parametrize(
    ("chunks", "answer"),
    [
        (answers(), Answer.HEALTHY),
        (answers(b"\x01\x04"), Answer.HEALTHY),
        ((Chunk(-0.2, encode(ENCODER, b"\x12\xff")), *answers()), Answer.HEALTHY),
        ((), Answer.SILENT),
        ((Chunk(0.5, encode(ENCODER, b"\x12\xff")),), Answer.SILENT),
        (answers(after_s=2.5), Answer.LATE),
        (answers(b"\x01\x02"), Answer.OLD),
        (answers(b"\x02\x00"), Answer.OLD),
        ((Chunk(0.1, b">>> \r\nTraceback (most recent call last):\r\n"),), Answer.FOREIGN),
        (answers()[:2], Answer.FOREIGN),
        (answers()[:1], Answer.FOREIGN),
    ],
)
def test_answers_are_told_apart(chunks: tuple[Chunk, ...], answer: Answer) -> None:
    assert examine(chunks).answer is answer


def test_examination_has_version_id_and_encoder_reports() -> None:
    found = examine((*answers(), Chunk(0.2, encode(ENCODER, b"\x12\xff") * 3)))
    assert (found.version, found.unique_id, found.encoder_reports, found.skipped) == ("1.3", "0001020304050607", 3, 0)
    assert found.answered_s == 0.01 and examine(()).version == ""
