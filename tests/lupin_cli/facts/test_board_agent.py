"""The agent that asks the motor board, against a simulated board on a pseudo-terminal."""

from __future__ import annotations

import fcntl
import os
import termios
from pathlib import Path

import pytest

from lupin_cli.facts import board_agent
from lupin_runtime.board_protocol import LOOP_BACK, PROBE_REQUESTS, encode
from lupin_sim.motor_board import Firmware, SimulatedBoard
from tests.support.board_probe import held_port

TIOCGEXCL = 0x80045440  # linux/ioctls.h; Python's termios lacks it

pytestmark = pytest.mark.skipif(os.geteuid() != 0, reason="only root sees the open files of all processes")


def test_holder_behind_a_link_is_found_by_its_device(tmp_path: Path) -> None:
    with SimulatedBoard(Firmware()) as board:
        link = tmp_path / "board"
        link.symlink_to(board.port)
        assert list(board_agent.find_holders(board.port)) == []
        with held_port(str(link)) as pid:
            assert [line.split()[0] for line in board_agent.find_holders(board.port)] == [str(pid)]


def is_exclusive(file: int) -> bool:
    return fcntl.ioctl(file, TIOCGEXCL, bytes(4)) != bytes(4)


def test_port_is_exclusive_and_left_as_it_was() -> None:
    with SimulatedBoard(Firmware()) as board:
        with board_agent.exclusive_port(board.port) as file:
            speeds = termios.tcgetattr(file)[4:6]
            assert is_exclusive(file) and speeds == [termios.B115200, termios.B115200]
            assert not termios.tcgetattr(file)[2] & termios.HUPCL
        file = os.open(board.port, os.O_RDWR | os.O_NOCTTY)
        assert not is_exclusive(file)
        assert not termios.tcgetattr(file)[2] & termios.HUPCL  # the modem lines stay as they are on close
        os.close(file)


def test_port_that_another_program_has_locked_is_refused() -> None:
    with SimulatedBoard(Firmware()) as board:
        locked = os.open(board.port, os.O_RDWR | os.O_NOCTTY)
        fcntl.flock(locked, fcntl.LOCK_EX)
        with pytest.raises(board_agent.Refused, match="cannot be used alone"), board_agent.exclusive_port(board.port):
            pytest.fail("the port was opened")
        os.close(locked)


def test_port_without_a_board_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    board_agent.main(str(tmp_path / "ttyACM0"), "")
    assert "@@ refused" in capsys.readouterr().out
    (tmp_path / "file").touch()
    board_agent.main(str(tmp_path / "file"), "")
    assert "@@ refused\nit is no device" in capsys.readouterr().out


def test_unplugged_board_ends_the_exchange(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    board = SimulatedBoard(Firmware())
    send = board_agent.send

    def send_and_unplug(file: int, requests: bytes) -> None:
        board.close()
        send(file, requests)

    monkeypatch.setattr(board_agent, "send", send_and_unplug)
    board_agent.main(board.port, b"".join(PROBE_REQUESTS).hex())
    assert capsys.readouterr().out.splitlines()[-2:] == ["@@ failed", "Input/output error"]


def test_board_that_never_stops_sending_is_cut_off(capsys: pytest.CaptureFixture[str]) -> None:
    with SimulatedBoard(Firmware()) as board, board_agent.exclusive_port(board.port) as file:
        for _ in range(3):
            board.send(encode(LOOP_BACK, b"\x01") * 1000)
            received = board_agent.listen(file, 0.5, lambda _: True, 0.0)
            assert 0 < received <= board_agent.MAX_BYTES
    assert capsys.readouterr().out
