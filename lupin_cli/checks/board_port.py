"""The serial port of the motor board: who holds it, whether the board is there and has power, and what runs on it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from lupin_cli.checks.base import Check, Finding, Snapshot
from lupin_cli.checks.controllers import observed_graphs
from lupin_cli.checks.findings import make_finding
from lupin_cli.checks.motor_board import BOARD_SIGNS, MOTOR_SUPPLY_V, has_board_port, has_left_bus
from lupin_cli.checks.remote_command import command_on_robot
from lupin_cli.facts.devices import DEVICES, Devices, Holder
from lupin_cli.facts.graph import GRAPH
from lupin_cli.facts.motor_board import BOOT_LOADER, MICROPYTHON, MOTOR_BOARD, USB_VENDOR, MotorBoard
from lupin_cli.facts.system_journal import SYSTEM_JOURNAL
from lupin_cli.facts.units import VENDOR
from lupin_runtime.board_protocol import OLDEST_FIRMWARE, Answer
from lupin_runtime.graph import BATTERY

# The vendor's own way: https://docs.mirte.org, "Install MCU software", and run_arduino.sh of mirte-install-scripts.
_FIRMWARE_FILE = "/usr/local/src/mirte/mirte-install-scripts/Telemetrix4RpiPico.uf2"
_LOAD_FIRMWARE = f"sudo picotool load -f {_FIRMWARE_FILE} && sudo picotool reboot"
_DRIVER = "telemetrix"


def find_held_port(snapshot: Snapshot) -> Iterator[Finding]:
    """Another program than the vendor's driver has the board's port open, and takes a part of what the board sends."""
    board, devices = snapshot.robot_fact(MOTOR_BOARD), snapshot.robot_fact(DEVICES)
    holders = _foreign_holders(board, devices) if board is not None and devices is not None else ()
    if not holders:
        return
    names = ", ".join(dict.fromkeys(f"{holder.program} (pid {holder.pid})" for holder in holders))
    services = sorted({holder.unit for holder in holders if holder.unit.endswith(".service")})
    processes = [str(holder.pid) for holder in holders if not holder.unit.endswith(".service")]
    commands = [f"sudo systemctl stop {' '.join(services)}"] if services else []
    commands += [f"sudo kill {' '.join(processes)}"] if processes else []
    commands += [f"sudo systemctl restart {VENDOR}"] if board is not None and board.not_asked else []  # it has lost answers
    yield make_finding(
        "board-held",
        where="robot",
        cause=f"{names} has the motor board's port open, so that the vendor's driver cannot open it or loses answers",
        evidence=(holder.line() for holder in holders),
        command=command_on_robot(snapshot, " && ".join(commands)),
        explains={"board-wedged", *BOARD_SIGNS},
    )


def _foreign_holders(board: MotorBoard, devices: Devices) -> tuple[Holder, ...]:
    known = {holder.pid: holder for holder in devices.holders if holder.device in board.serial_ports}
    if board.asked:  # the other probe may have met the agent that asks the board
        seen = [(asked.port, *line.split(" ", 1)) for asked in board.asked for line in asked.holders]
        return tuple(known.get(int(pid), Holder(int(pid), port, "-", name, name)) for port, pid, name in seen)
    drivers = {process.pid for process in devices.telemetrix}
    return tuple(
        holder
        for holder in known.values()
        if holder.pid not in drivers and holder.unit != VENDOR and _DRIVER not in holder.command
    )


def find_wrong_firmware(snapshot: Snapshot) -> Iterator[Finding]:
    """The board runs no firmware, an old one, or another program."""
    board = snapshot.robot_fact(MOTOR_BOARD)
    if board is None or any(asked.examination and asked.examination.answer is Answer.HEALTHY for asked in board.asked):
        return  # another board beside a healthy one is no motor board
    cause, evidence = "", [each.line() for each in board.usb]
    products = {each.product for each in board.usb} if _has_driver(snapshot) else set()
    if products == {BOOT_LOADER}:
        cause = "the board waits in its boot loader, without a firmware"
    elif products == {MICROPYTHON}:
        cause = "the board runs MicroPython instead of the vendor's firmware"
    for asked in board.asked:
        examination = asked.examination
        if examination is None or examination.answer not in (Answer.OLD, Answer.FOREIGN):
            continue
        evidence += asked.lines()
        cause = "the board does not answer as the vendor's firmware does: another program runs on it, or its cable is damaged"
        if examination.answer is Answer.OLD:
            needed = ".".join(map(str, OLDEST_FIRMWARE))
            cause = f"the board runs the firmware {examination.version}; the vendor's driver of MIRTE OS 0.2 needs {needed}"
    if cause:
        restart = f"sudo systemctl stop {VENDOR}; {_LOAD_FIRMWARE}; sudo systemctl start {VENDOR}"
        yield make_finding(
            "board-firmware-wrong",
            where="robot",
            cause=cause,
            evidence=evidence,
            command=command_on_robot(snapshot, restart),
            instruction="the command stops the robot's stack, loads the vendor's firmware and starts the stack again",
            explains={"board-wedged", *BOARD_SIGNS},
        )


def find_unpowered_board(snapshot: Snapshot) -> Iterator[Finding]:
    """The board's USB port is switched off, or the board has power and its motors have none."""
    board = snapshot.robot_fact(MOTOR_BOARD)
    denied = [each for each in board.usb if not each.authorized] if board is not None and _has_driver(snapshot) else []
    is_missing = board is not None and not board.usb and not board.serial_ports and _has_driver(snapshot)
    off = board.hub_ports if board is not None and is_missing else ()
    disabled = [line.split()[0] for line in off if line.endswith(" disabled")]
    if denied:
        yield _unpowered(
            "the kernel may not use the board: its USB device is not authorized",
            [each.line() for each in denied],
            command=command_on_robot(snapshot, f"echo 1 | sudo tee /sys/bus/usb/devices/{denied[0].name}/authorized"),
        )
    elif disabled:
        yield _unpowered(
            "the board is not on the USB, and a port of the USB is switched off",
            off,
            command=command_on_robot(snapshot, f"echo 0 | sudo tee {' '.join(f'{path}/disable' for path in disabled)}"),
        )
    elif off:
        yield _unpowered(
            "the board is not on the USB, and a port of the USB was switched off because too much current flowed",
            off,
            instruction="unplug the board's USB cable, look for a short circuit on the board, and plug the cable in again",
        )
    for graph in observed_graphs(snapshot):
        volts = graph.battery[1] if graph.battery is not None else None
        if graph.kind == "robot" and volts is not None and volts < MOTOR_SUPPLY_V:
            yield _unpowered(
                f"the motors' supply has {volts:.1f} V: the board runs from the USB, and its motors have no power",
                [f"{BATTERY.name} on {graph.name}: voltage {volts:.2f} V"],
                instruction="switch the robot's main switch on, and check the battery's plug and fuse",
                graph=graph.name,
            )


def _unpowered(cause: str, evidence: Sequence[str], *, command: str = "", instruction: str = "", graph: str = "") -> Finding:
    """Return the finding; with a graph, the board itself has power: its data arrives."""
    return make_finding(
        "board-unpowered",
        where="robot",
        cause=cause,
        evidence=evidence,
        command=command,
        instruction=instruction,
        explains={"battery-low", "battery-unreadable"} if graph else {"board-absent", *BOARD_SIGNS},
        breaks=() if graph else None,
        graph=graph,
    )


def find_absent_board(snapshot: Snapshot) -> Iterator[Finding]:
    """The vendor's driver looks for a board, and none is on the USB."""
    board, devices = snapshot.robot_fact(MOTOR_BOARD), snapshot.robot_fact(DEVICES)
    if board is None or devices is None or board.usb or board.serial_ports or has_board_port(devices):
        return
    if not _has_driver(snapshot) or has_left_bus(snapshot):
        return
    yield make_finding(
        "board-absent",
        where="robot",
        cause="no motor board is on the robot's USB: it is not plugged in, has no power, or is broken",
        evidence=(f"no {USB_VENDOR}:* among the {len(devices.usb)} USB devices", *_driver_lines(snapshot)[-3:]),
        command=command_on_robot(snapshot, f"lsusb -d {USB_VENDOR}:"),
        instruction="check the USB cable between computer and board at both ends; the command lists the board once it is there",
        explains={"board-wedged", *BOARD_SIGNS},
    )


def _driver_lines(snapshot: Snapshot) -> list[str]:
    """Return the lines of the system journal that name the vendor's driver of the board."""
    journal = snapshot.robot_fact(SYSTEM_JOURNAL)
    return [line.line for line in (journal.units if journal else ()) if _DRIVER in line.raw.lower()]


def _has_driver(snapshot: Snapshot) -> bool:
    """Return whether the robot uses a board. A simulated one does not, and sees the USB of the computer on which it runs."""
    devices = snapshot.robot_fact(DEVICES)
    return bool((devices and devices.telemetrix) or _driver_lines(snapshot))


CHECKS = (
    Check("board.holder", find_held_port, robot=(MOTOR_BOARD, DEVICES)),
    Check("board.firmware", find_wrong_firmware, robot=(MOTOR_BOARD, DEVICES, SYSTEM_JOURNAL)),
    Check("board.power", find_unpowered_board, laptop=(GRAPH,), robot=(MOTOR_BOARD, DEVICES, SYSTEM_JOURNAL)),
    Check("board.presence", find_absent_board, robot=(MOTOR_BOARD, DEVICES, SYSTEM_JOURNAL)),
)
