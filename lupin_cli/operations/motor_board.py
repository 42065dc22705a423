"""`motor-board`: the motor board answers on its serial port; if it does not, it is restarted over the USB."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from lupin_cli.connection.base import Output, Script, Target
from lupin_cli.facts.motor_board import MOTOR_BOARD, AskedPort, MotorBoard
from lupin_cli.operations.base import Difference, Operation, OperationError, probe_script
from lupin_cli.operations.shell import change
from lupin_runtime.board_protocol import Answer

# `picotool reboot -f` asks the interface that the board's USB code has beside the serial port, which works while its program
# hangs. Its motors stop, since all of its pins become inputs. The stack must be down: it would be cut off in the middle.
_RESTART = """
state=$(systemctl show -p ActiveState --value mirte-ros.service 2>/dev/null)
case $state in inactive | failed | '') ;; *) echo "mirte-ros.service is $state" >&2; exit 1 ;; esac
grep -lqa '[t]elemetrix' /proc/[0-9]*/cmdline 2>/dev/null && { echo 'a driver of the board still runs' >&2; exit 1; }
command -v picotool >/dev/null || { echo 'the robot has no picotool' >&2; exit 1; }
picotool reboot -f
"""
_BY_HAND = "unplug the board's USB cable and plug it in again"


@dataclass(frozen=True, kw_only=True)
class MotorBoardAnswers(Operation):
    """Asks the board as `lupin doctor` does. A restart does not help a board that is held, missing or runs an old firmware."""

    name: ClassVar[str] = "motor-board"
    effect: ClassVar[str] = "the motor board answers; if not, it is restarted; refuses while the vendor's service runs"
    settle_s: ClassVar[float] = 30.0  # it is back on the USB within some seconds, and is asked for up to 5 s

    _is_restarted: bool = False

    def __post_init__(self) -> None:
        if self.machine == "laptop":
            raise ValueError("the motor board belongs to the robot")

    @property
    def inspect_command(self) -> str:
        return "lupin doctor"

    def with_baseline(self, before: Mapping[str, Any]) -> MotorBoardAnswers:
        return replace(self, _is_restarted=True)

    def probe(self) -> Script:
        return probe_script(MOTOR_BOARD.probe, root=True, timeout_s=MOTOR_BOARD.timeout_s)

    def judge(self, output: Output) -> Difference | None:
        try:
            board = MOTOR_BOARD.parse(output)
        except ValueError as error:
            raise OperationError(f"could not examine the motor board: {error}", self.inspect_command) from error
        if board.not_asked:
            return Difference(f"ask the motor board, and restart it unless it answers ({board.not_asked})")
        if not self._is_restarted:
            _require_restart_helps(board)
        fault = _fault(board)
        return Difference(f"restart the motor board: {fault}") if fault else None

    def change(self, target: Target, difference: Difference) -> None:
        try:
            change(target, _RESTART, "restart the motor board", root=True, timeout_s=20.0)
        except OperationError as error:
            raise OperationError(f"{error}; {_BY_HAND}", "lupin play recover-board") from error


def _require_restart_helps(board: MotorBoard) -> None:
    """Raise OperationError if a restart of the board would change nothing."""
    if not board.usb and not board.serial_ports:
        raise OperationError("no motor board is on the robot's USB; check its cable", "lupin doctor")
    if any(_is_healthy(asked) for asked in board.asked):
        return
    for asked in board.asked:
        if asked.examination is None:
            raise OperationError(f"the motor board cannot be asked: {asked.lines()[0]}", "lupin doctor")
        if asked.examination.answer is Answer.OLD:
            raise OperationError(f"the motor board runs the old firmware {asked.examination.version}", "lupin doctor")


def _fault(board: MotorBoard) -> str:
    """Return what is wrong with the board; empty if it answers."""
    if not board.asked:
        return "it has no serial port"
    if any(_is_healthy(asked) for asked in board.asked):
        return ""  # another one is no motor board
    return next((asked.lines()[0] for asked in board.asked if not _is_healthy(asked)), "")


def _is_healthy(asked: AskedPort) -> bool:
    return asked.examination is not None and asked.examination.answer is Answer.HEALTHY
