"""One fault of `bench.triage`: how to inject it, how to undo it, and which other faults can exist at the same time."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from bench.fault_rig import NAME, START_STOPPED_UNITS, FaultRig, RigError

Action = Callable[[FaultRig], object]

# What a fault's evidence may need and another fault may take away:
ONBOARD = "onboard unit"  # it publishes the state of the drive bus
# While controllers are lost, it is stopped and disabled: systemd forgets its failure and reads all unit files again.
AUTO_HOME = "state of auto-home"
PROFILE = "super client's profile"


def no_action(_: FaultRig) -> None:
    """Do nothing: `FaultRig.restore`, or undoing another fault, undoes this one."""


@dataclass(frozen=True)
class Case:
    """One fault, and the findings that the doctor must report for it."""

    name: str
    expected: frozenset[str]
    inject: Action
    undo: Action = no_action
    exclusive_group: str = ""  # two faults of the same group exclude each other
    hides_graph: bool = False  # the doctor sees nothing of the robot's graph while the fault lasts
    needs_graph: bool = False  # the evidence is on the robot's graph
    unreachable: bool = False  # the robot cannot be reached
    on_robot: bool = True  # the evidence is on the robot
    shell: str = "sourced"  # the environment in which the doctor runs; see FaultRig.shells
    robot: str = NAME  # the inventory's name by which the doctor reaches the robot
    needs: str = ""  # the part without which there is no evidence
    takes: str = ""  # the part that is not there while the fault lasts
    hides: tuple[str, ...] = ()  # names of other faults whose evidence this one removes

    def is_compatible(self, other: Case) -> bool:
        """Whether both faults can exist, and be detected, at the same time."""
        if (
            (self.exclusive_group and self.exclusive_group == other.exclusive_group)
            or self.name in other.hides
            or other.name in self.hides
        ):
            return False
        if (self.hides_graph and other.needs_graph) or (other.hides_graph and self.needs_graph):
            return False
        if (self.takes and self.takes == other.needs) or (other.takes and other.takes == self.needs):
            return False
        if (self.unreachable and other.on_robot) or (other.unreachable and self.on_robot):
            return False
        return len({self.shell, other.shell} - {"sourced"}) <= 1 and self.robot == other.robot


def host_fault(
    name: str, fault: str, expected: str, group: str = "", settings: Mapping[str, Any] | None = None, **fields: Any
) -> Case:
    """Return a fault of `lupin sim host fault`; `fields` are further fields of Case."""
    options = dict(settings or {})
    return Case(
        name,
        frozenset({expected}),
        lambda rig: rig.host.robot.inject_fault(fault, **options),
        lambda rig: rig.host.robot.undo_fault(fault, **options),
        group,
        **fields,
    )


def stack_fault(name: str, fault: str, expected: str, settings: Mapping[str, Any] | None = None) -> Case:
    """Return a fault that restarts the vendor's stack; then Lupin's units start again, as after a boot."""
    options = dict(settings or {})

    def inject(rig: FaultRig) -> None:
        rig.host.robot.inject_fault(fault, **options)
        rig.root(START_STOPPED_UNITS, 90.0)

    return Case(
        name,
        frozenset({expected}),
        inject,
        host_fault(name, fault, expected, settings=options).undo,
        "server",
        hides_graph=True,
    )


def participant_fault(name: str, role: str, expected: str, group: str = "", needs: str = "") -> Case:
    """Return a fault that a participant of the graph on the laptop causes."""
    return Case(
        name,
        frozenset({expected}),
        lambda rig: rig.start_participant(role),
        lambda rig: rig.stop_participant(role),
        group or role,
        needs_graph=True,
        needs=needs,
    )


def order_fault(name: str, inject: str, undo: str, expected: str, group: str, needs: str = "") -> Case:
    """Return a fault that one order to the simulated robot causes and another undoes."""
    return Case(
        name,
        frozenset({expected}),
        lambda rig: rig.start_participant(*inject.split()),
        lambda rig: rig.start_participant(*undo.split()),
        group,
        needs_graph=True,
        needs=needs,
    )


def file_fault(name: str, path: str, change: Callable[[str], str | None], expected: str, group: str, **fields: Any) -> Case:
    """Return a wrong file in the operator's home; `change` maps its text to the wrong text, or to None to remove it."""

    def inject(rig: FaultRig) -> None:
        file = rig.home / path
        rig.write(file, change(file.read_text() if file.exists() else ""))

    return Case(name, frozenset({expected}), inject, exclusive_group=group, on_robot=False, **fields)


def profile_fault(name: str, old: str, new: str, expected: str) -> Case:
    """Return a wrong value in the super client's profile."""

    def change(text: str) -> str:
        if old not in text:
            raise RigError(f"the profile does not contain {old!r}")
        return text.replace(old, new)

    path = ".config/lupin/fastdds_super_client.xml"
    return file_fault(name, path, change, expected, "profile", hides_graph=True, needs=PROFILE)


def script_fault(name: str, inject: str, undo: str, expected: str, group: str, **fields: Any) -> Case:
    """Return a fault that one script on the robot, run as root, causes and another undoes."""
    return Case(name, frozenset({expected}), lambda rig: rig.root(inject), lambda rig: rig.root(undo), group, **fields)


def node_fault(name: str, expected: str, **variables: str | None) -> Case:
    """Return a node on the laptop whose environment variables do not match the robot's graph; None unsets a variable."""

    def inject(rig: FaultRig) -> None:
        env = {**rig.sourced_env, **{key: value for key, value in variables.items() if value is not None}}
        rig.start_participant(
            "talker", env={key: value for key, value in env.items() if variables.get(key, "") is not None}, name=name
        )

    return Case(name, frozenset({expected}), inject, lambda rig: rig.stop_participant(name), name, on_robot=False)


def port_fault(name: str, code: str, expected: str, port: int) -> Case:
    """Return a program on the laptop that listens on a port of Lupin's."""

    def inject(rig: FaultRig) -> None:
        process = rig.host.popen([sys.executable, "-c", code], rig.bare_env, stdout=subprocess.PIPE, text=True)
        assert process.stdout is not None and process.stdout.readline() == "up\n"
        rig.participants[name] = process

    return Case(name, frozenset({expected}), inject, lambda rig: rig.stop_participant(name), f"port {port}", on_robot=False)
