"""One fault of `bench.fault_table`: how to inject it, how to undo it, and which other faults can exist at the same time."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from bench.fault_rig import ROBOT, START_STOPPED_UNITS, FaultRig, RigError

Action = Callable[[FaultRig], object]

# What the evidence of one fault may need and another fault may remove:
ONBOARD = "onboard unit"  # it publishes the state of the drive bus
# The controllers-… faults stop and disable lupin-auto-home. That resets its failed state and reloads all unit files.
AUTO_HOME = "state of auto-home"
PROFILE = "super client's profile"


def no_action(_: FaultRig) -> None:
    """Do nothing. As `inject`: the environment of the doctor is the fault. As `undo`: `FaultRig.restore` removes the fault."""


@dataclass(frozen=True)
class FaultCase:
    """One fault, and the findings that the doctor must report for it."""

    name: str
    expected: frozenset[str]
    inject: Action
    undo: Action = no_action
    exclusive_group: str = ""  # two faults of the same group exclude each other
    hides_graph: bool = False  # the doctor sees nothing of the robot's graph while the fault lasts
    needs_graph: bool = False  # the evidence is on the robot's graph
    unreachable: bool = False  # the doctor cannot read evidence on the robot while the fault lasts
    on_robot: bool = True  # the evidence is on the robot
    shell: str = "sourced"  # the environment in which the doctor runs; see FaultRig.environments
    robot: str = ROBOT  # the robot's name in the inventory, for the doctor's --robot
    needs: str = ""  # ONBOARD, AUTO_HOME or PROFILE: without it there is no evidence
    removes: str = ""  # ONBOARD, AUTO_HOME or PROFILE: it is missing while the fault lasts
    hides: tuple[str, ...] = ()  # names of other faults whose evidence this one removes

    def is_compatible(self, other: FaultCase) -> bool:
        """Return whether both faults can exist, and be detected, at the same time."""
        if (
            (self.exclusive_group and self.exclusive_group == other.exclusive_group)
            or self.name in other.hides
            or other.name in self.hides
        ):
            return False
        if (self.hides_graph and other.needs_graph) or (other.hides_graph and self.needs_graph):
            return False
        if (self.removes and self.removes == other.needs) or (other.removes and other.removes == self.needs):
            return False
        if (self.unreachable and other.on_robot) or (other.unreachable and self.on_robot):
            return False
        return len({self.shell, other.shell} - {"sourced"}) <= 1 and self.robot == other.robot


def host_fault(
    name: str,
    *,
    expected: str,
    group: str = "",
    fault: str = "",
    settings: Mapping[str, Any] | None = None,
    **fields: Any,
) -> FaultCase:
    """Return the case of a fault of `lupin sim host fault`; `fault` is its name there (default: `name`).

    `settings` are those of the fault, `fields` further fields of FaultCase.
    """
    options = dict(settings or {})
    return FaultCase(
        name,
        frozenset({expected}),
        lambda rig: rig.machines.robot.inject_fault(fault or name, **options),
        lambda rig: rig.machines.robot.undo_fault(fault or name, **options),
        group,
        **fields,
    )


def vendor_stack_fault(name: str, *, expected: str, fault: str = "", settings: Mapping[str, Any] | None = None) -> FaultCase:
    """Return the case of a fault that restarts the vendor's stack; then Lupin's units start again, as after a boot."""
    options = dict(settings or {})

    def inject(rig: FaultRig) -> None:
        rig.machines.robot.inject_fault(fault or name, **options)
        rig.run_as_root(START_STOPPED_UNITS, 90.0)

    return FaultCase(
        name,
        frozenset({expected}),
        inject,
        host_fault(name, expected=expected, fault=fault, settings=options).undo,
        "vendor-stack",
        hides_graph=True,
    )


def participant_fault(name: str, *, role: str, expected: str, group: str = "", needs: str = "") -> FaultCase:
    """Return the case of a fault that a participant of the graph on the laptop causes, for as long as it runs."""
    return FaultCase(
        name,
        frozenset({expected}),
        lambda rig: rig.start_participant(role),
        lambda rig: rig.stop_process(role),
        group or role,
        needs_graph=True,
        needs=needs,
    )


def command_fault(name: str, *, inject: str, undo: str, expected: str, group: str, needs: str = "") -> FaultCase:
    """Return the case of a fault that one command of `tests.support.graph_participant` causes and another undoes."""
    return FaultCase(
        name,
        frozenset({expected}),
        lambda rig: rig.start_participant(*inject.split()),
        lambda rig: rig.start_participant(*undo.split()),
        group,
        needs_graph=True,
        needs=needs,
    )


def file_fault(
    name: str, path: str, change: Callable[[str], str | None], *, expected: str, group: str, **fields: Any
) -> FaultCase:
    """Return the case of a wrong file in the operator's home.

    `change` maps its text to the wrong text, or to None to remove it.
    """

    def inject(rig: FaultRig) -> None:
        file = rig.home / path
        rig.write_file(file, change(file.read_text() if file.exists() else ""))

    return FaultCase(name, frozenset({expected}), inject, exclusive_group=group, on_robot=False, **fields)


def profile_fault(name: str, old: str, new: str, *, expected: str) -> FaultCase:
    """Return the case of a wrong value in the super client's profile, in which `new` replaces `old`."""

    def change(text: str) -> str:
        if old not in text:
            raise RigError(f"the profile does not contain {old!r}")
        return text.replace(old, new)

    path = ".config/lupin/fastdds_super_client.xml"
    return file_fault(name, path, change, expected=expected, group="profile", hides_graph=True, needs=PROFILE)


def script_fault(name: str, *, inject: str, undo: str, expected: str, group: str, **fields: Any) -> FaultCase:
    """Return the case of a fault that one script on the robot, run as root, causes and another undoes."""
    return FaultCase(
        name,
        frozenset({expected}),
        lambda rig: rig.run_as_root(inject),
        lambda rig: rig.run_as_root(undo),
        group,
        **fields,
    )


def node_fault(name: str, *, expected: str, **variables: str | None) -> FaultCase:
    """Return the case of a node on the laptop whose environment variables do not match the robot's graph.

    None unsets a variable.
    """

    def inject(rig: FaultRig) -> None:
        env = {**rig.sourced_env, **{key: value for key, value in variables.items() if value is not None}}
        rig.start_participant(
            "talker", env={key: value for key, value in env.items() if variables.get(key, "") is not None}, name=name
        )

    return FaultCase(name, frozenset({expected}), inject, lambda rig: rig.stop_process(name), name, on_robot=False)


def port_fault(name: str, program: str, *, expected: str, port: int) -> FaultCase:
    """Return the case of a Python program on the laptop that listens on a port of Lupin's and prints `up`."""

    def inject(rig: FaultRig) -> None:
        process = rig.machines.popen([sys.executable, "-c", program], rig.bare_env, stdout=subprocess.PIPE, text=True)
        assert process.stdout is not None and process.stdout.readline() == "up\n"
        rig.processes[name] = process

    return FaultCase(name, frozenset({expected}), inject, lambda rig: rig.stop_process(name), f"port {port}", on_robot=False)
