"""The simulated motor board: its firmware obeys and reports as the Pico's does, with each fault."""

from __future__ import annotations

import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.board_protocol import (
    ENCODER,
    FIRMWARE,
    LOOP_BACK,
    PROBE_REQUESTS,
    UNIQUE_ID,
    Answer,
    Chunk,
    Report,
    decode,
    encode,
    examine,
)
from lupin_sim.motor_board import BOARD_ID, ENCODER_NEW, FEATURE, MOVING, PING, PWM_WRITE, BoardFault, Firmware, SimulatedBoard

PIN = 18
CONFIGURE = encode(ENCODER_NEW, bytes((2, PIN, 19)))


@pytest.mark.parametrize(
    ("fault", "answer"),
    [
        (BoardFault.NONE, Answer.HEALTHY),
        (BoardFault.SILENT, Answer.SILENT),
        (BoardFault.ENCODERS_SILENT, Answer.HEALTHY),
        (BoardFault.GARBAGE, Answer.FOREIGN),
        (BoardFault.FOREIGN, Answer.FOREIGN),
    ],
)
def test_firmware_with_a_fault_is_examined_as_such(fault: BoardFault, answer: Answer) -> None:
    sent = Firmware(fault=fault).receive(b"".join(PROBE_REQUESTS))
    assert examine([Chunk(0.01, sent)]).answer is answer


def test_firmware_answers_each_request_of_the_probe() -> None:
    firmware = Firmware((1, 4))
    found, skipped = decode(firmware.receive(b"".join(PROBE_REQUESTS)))
    assert [report.id for report in found] == [LOOP_BACK, FIRMWARE, UNIQUE_ID, LOOP_BACK] == firmware.requests
    assert (found[1].data, found[2].data, skipped) == (b"\x01\x04", BOARD_ID, 0)
    assert not set(firmware.requests) & MOVING


def test_only_configured_encoders_report_turned_wheels() -> None:
    firmware = Firmware()
    assert firmware.turn_wheel(PIN, 3) == b""
    firmware.receive(CONFIGURE)
    assert decode(firmware.turn_wheel(PIN, -3))[0] == (Report(ENCODER, bytes((PIN, 253))),)


def test_silent_encoders_leave_the_other_answers() -> None:
    firmware = Firmware(fault=BoardFault.ENCODERS_SILENT)
    firmware.receive(CONFIGURE)
    assert firmware.turn_wheel(PIN, 3) == b""
    assert decode(firmware.receive(encode(PING, b"\x07")))[0] == (Report(PING, b"\x07\x2a"),)


def test_old_firmware_is_lost_when_asked_for_features() -> None:
    firmware = Firmware((1, 2))
    assert examine([Chunk(0.0, firmware.receive(b"".join(PROBE_REQUESTS)))]).answer is Answer.OLD
    assert firmware.receive(encode(FEATURE, b"\x05")) == b"" and firmware.stuck
    assert firmware.receive(encode(FIRMWARE)) == b""
    assert decode(Firmware().receive(encode(FEATURE, b"\x05")))[0] == (Report(FEATURE, b"\x05\x01"),)


def test_half_a_request_is_forgotten_after_a_pause() -> None:
    half = encode(PWM_WRITE, b"\x11\x00\xff")[:-1]
    without_pause, with_pause = Firmware(), Firmware()
    assert without_pause.receive(half) == with_pause.receive(half) == b""
    with_pause.end_pause()
    for firmware in (without_pause, with_pause):
        firmware.receive(b"".join(PROBE_REQUESTS))
    assert PWM_WRITE in without_pause.requests  # so the probe waits before it sends
    assert with_pause.requests == [LOOP_BACK, FIRMWARE, UNIQUE_ID, LOOP_BACK]


@given(st.lists(st.binary(max_size=80), max_size=10), st.sampled_from(BoardFault))
def test_firmware_survives_garbage(pieces: list[bytes], fault: BoardFault) -> None:
    firmware = Firmware(fault=fault)
    for piece in pieces:
        assert isinstance(firmware.receive(piece), bytes)


def test_board_answers_on_its_port_and_sends_by_itself() -> None:
    with SimulatedBoard(Firmware()) as board:
        port = os.open(board.port, os.O_RDWR | os.O_NOCTTY)
        try:
            os.write(port, encode(FIRMWARE))
            assert os.read(port, 100) == encode(FIRMWARE, b"\x01\x03")
            board.send(encode(ENCODER, b"\x12\x01"))
            assert os.read(port, 100) == encode(ENCODER, b"\x12\x01")
        finally:
            os.close(port)
        board.close()


def test_unplugged_board_hangs_up_its_port() -> None:
    board = SimulatedBoard(Firmware())
    port = os.open(board.port, os.O_RDWR | os.O_NOCTTY)
    try:
        board.close()
        with pytest.raises(OSError, match="Input/output error"):
            os.write(port, encode(FIRMWARE))
    finally:
        os.close(port)
