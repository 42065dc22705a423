"""Cases of generated faults: how they are drawn, and how a diagnosis is judged by ground truth and by what they touch."""

from __future__ import annotations

import random
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from bench.faults.fault import LAYERS, LINK, ROBOT, Builder, Effect, Fault, Step
from bench.generated_faults import BREAKING, HARMLESS

HARMLESS_SHARE, SINGLE_SHARE, PAIR_SHARE = 0.15, 0.55, 0.18  # the rest: one fault beside a harmless one
MAX_DRAWS = 200  # of a second fault that fits the first

# A robot that nobody can examine answers nothing, whichever of these layers is broken at its end or in between.
SILENT_LAYERS = ("carrier", "address", "route")
UNEXPLAINED_LAYER = "samples"


@dataclass(frozen=True)
class Case:
    """One case: `number` of the draw by `seed`, and its faults in the order in which they are made."""

    seed: int
    number: int
    faults: tuple[Fault, ...]

    @property
    def text(self) -> str:
        """What its faults do."""
        return " + ".join(f"{fault.verb}: {fault.text}" for fault in self.faults)

    @property
    def layers(self) -> frozenset[str]:
        """The layers of its roots; empty if it has no effect."""
        return frozenset(fault.layer for fault in self.faults if fault.layer)

    @property
    def steps(self) -> tuple[Step, ...]:
        """All changes, in the order in which they are made. They are undone in the opposite order."""
        return tuple(step for fault in self.faults for step in fault.steps)

    @property
    def variables(self) -> dict[str, str | None]:
        """The changes to the environment of the operator's shell; None unsets a variable."""
        return {name: value for fault in self.faults for name, value in fault.variables}


def draw_case(seed: int, number: int) -> Case:
    """Return a case that depends on nothing but seed and number."""
    rng = random.Random(f"{seed}/{number}")
    kind = rng.random()
    if kind < HARMLESS_SHARE:
        return Case(seed, number, (rng.choice(HARMLESS)(rng),))
    first = rng.choice(BREAKING)(rng)
    if kind < HARMLESS_SHARE + SINGLE_SHARE:
        return Case(seed, number, (first,))
    second = _draw_beside(first, BREAKING if kind < HARMLESS_SHARE + SINGLE_SHARE + PAIR_SHARE else HARMLESS, rng)
    return Case(seed, number, tuple(sorted((first, second), key=_order)))


def draw_cases(seed: int, only: str = "") -> Iterator[Case]:
    """Yield cases without end, each text once; `only` restricts them to those with a root at this layer."""
    seen: set[str] = set()
    number = 0
    while True:
        case = draw_case(seed, number)
        number += 1
        if case.text not in seen and (not only or only in case.layers):
            seen.add(case.text)
            yield case


def _draw_beside(first: Fault, builders: Sequence[Builder], rng: random.Random) -> Fault:
    for _ in range(MAX_DRAWS):
        second = rng.choice(builders)(rng)
        if are_independent(first, second):
            return second
    raise AssertionError(f"no fault of {len(builders)} kinds is independent of {first.text}")


def are_independent(one: Fault, other: Fault) -> bool:
    """Whether both faults can exist at the same time, and neither undoes or repairs the other."""
    if one.part == other.part or (one.layer and one.layer == other.layer) or (one.restarts and other.restarts):
        return False
    touched = [{_target(step) for step in fault.steps} for fault in (one, other)]
    return not (touched[0] & touched[1]) and not (dict(one.variables).keys() & dict(other.variables).keys())


def _target(step: Step) -> tuple[str, str]:
    """What a step's undo restores: the same target of two steps would be restored to the state between both."""
    return step.where, step.undo


def _order(fault: Fault) -> int:
    """The order in which faults are made: restarts would repair others, and after a full disk nothing can be written."""
    return 0 if fault.restarts else 2 if fault.verb == "fill" else 1


# -- judgement --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Truth:
    """What an operator on the laptop has: `broken` has one line for each thing that does not work; `login` is SSH."""

    broken: tuple[str, ...]
    login: bool
    took_s: float = 0.0

    @property
    def fine(self) -> bool:
        """Whether everything works for the operator, except perhaps the login."""
        return not self.broken


@dataclass(frozen=True)
class Judgement:
    """How a diagnosis compares with the truth. `expected` and `named` have the form LAYER@MACHINE."""

    expected: tuple[str, ...]
    named: tuple[str, ...]
    root_right: bool
    machine_right: bool
    healthy_while_broken: bool = False
    root_while_fine: bool = False

    @property
    def right(self) -> bool:
        """Whether nothing about the diagnosis is wrong."""
        return self.root_right and self.machine_right and not self.healthy_while_broken and not self.root_while_fine


def accepted_roots(case: Case) -> dict[Fault, frozenset[tuple[str, str]]]:
    """Return the layers and machines that are right for each fault with an effect.

    While the robot cannot be examined, its end and the link look the same from the laptop, and so do the layers at which it is
    silent. A fault that only the robot could show is then right as a symptom that nothing explains.
    """
    hidden = any(fault.hides_robot for fault in case.faults)
    accepted = {}
    for fault in case.faults:
        if fault.effect is Effect.NOTHING:
            continue
        layers, machines = {fault.layer, fault.also_layer} - {""}, {fault.machine}
        if hidden and fault.part == "cable" and fault.machine in (ROBOT, LINK):
            machines = {ROBOT, LINK}
            if fault.layer in SILENT_LAYERS:
                layers = set(SILENT_LAYERS)
        if _is_hidden(fault, case):
            layers, machines = {*layers, UNEXPLAINED_LAYER}, {*machines, ROBOT, LINK}
        accepted[fault] = frozenset((layer, machine) for layer in layers for machine in machines)
    return accepted


def required_faults(case: Case, truth: Truth) -> tuple[Fault, ...]:
    """Return the faults that a diagnosis must name: those that break something here, and that can be examined."""
    required = []
    for fault in case.faults:
        if fault.effect is Effect.NOTHING or _is_hidden(fault, case):
            continue
        if fault.layer == "login":
            breaks = not truth.login
        else:
            others = [other for other in case.faults if other is not fault]
            alone = all(other.effect is Effect.NOTHING or other.layer == "login" for other in others)
            breaks = not truth.fine and (fault.effect is Effect.BREAKS or alone)
        if breaks:
            required.append(fault)
    return tuple(required)


def _is_hidden(fault: Fault, case: Case) -> bool:
    """Whether only the robot could show a fault, and another one prevents that it is examined."""
    silences = fault.part == "cable" and fault.hides_robot
    if silences or not any(other.hides_robot for other in case.faults if other is not fault):
        return False
    # Ports between both ends need a socket at each; loss, addresses and routes of the link show in what the kernels answer.
    return fault.layer == "login" or fault.machine == ROBOT or (fault.machine == LINK and fault.layer == "ports")


def judge(case: Case, truth: Truth, report: Mapping[str, Any]) -> Judgement:
    """Compare a JSON report of the doctor with the truth.

    Its roots are its problems; warnings are advice. Each root must be one of those that the case's faults can have, and each
    fault that must be named needs one. While all works, nothing but what a fault touches may be named.
    """
    roots = {(root["layer"], root["machine"]) for root in report["findings"] if root["severity"] == "problem"}
    accepted = accepted_roots(case)
    right_roots = frozenset[tuple[str, str]]().union(*accepted.values())
    right_layers = {layer for layer, _ in right_roots}
    required = required_faults(case, truth)
    named_layers = {layer for layer, _ in roots}
    layers_named = all(named_layers & {layer for layer, _ in accepted[fault]} for fault in required)
    roots_named = all(roots & accepted[fault] for fault in required)
    unexplained = not truth.fine and not roots  # several faults that may break something, and none is named
    says_healthy = report["status"] == 0 or report.get("ground_truth", {}).get("state") == "healthy"
    return Judgement(
        _words(right_roots),
        _words(roots),
        root_right=layers_named and named_layers <= right_layers and not unexplained,
        machine_right=roots_named and roots <= right_roots and not unexplained,
        healthy_while_broken=not truth.fine and says_healthy,
        root_while_fine=truth.fine and truth.login and not roots <= right_roots,
    )


def _words(roots: Iterable[tuple[str, str]]) -> tuple[str, ...]:
    return tuple(sorted(f"{layer}@{machine}" for layer, machine in roots))


def fix_errors(before: Truth, after: Truth, report: Mapping[str, Any]) -> tuple[str, ...]:
    """Return what is wrong after `--fix`: what became worse, and what is said to be healed and is not.

    `report` is what the doctor said after its fixes.
    """
    errors = [f"worse after --fix: {line}" for line in after.broken if line not in before.broken and before.fine]
    if len(after.broken) > len(before.broken) and not before.fine:
        errors.append(f"worse after --fix: {len(before.broken)} broken before, {len(after.broken)} after")
    if before.login and not after.login:
        errors.append("worse after --fix: no login")
    if report["status"] == 0 and not after.fine:
        errors.append(f"said to be healed, but: {'; '.join(after.broken)}")
    remaining = {
        (finding["id"], finding["machine"]) for root in report["findings"] for finding in (root, *root["consequences"])
    }
    healed = [fix for fix in report["fixes"] if fix["state"] == "healed"]
    for fix in healed:
        if (fix["finding"], fix["machine"]) in remaining:
            errors.append(f"{fix['finding']} is marked healed and still reported")
    if healed and not after.fine and not any(root["severity"] == "problem" for root in report["findings"]):
        names = ", ".join(fix["finding"] for fix in healed)
        errors.append(f"{names} is marked healed, no other problem is named, and still: {'; '.join(after.broken)}")
    return tuple(errors)


def table_row_name(case: Case) -> str:
    """Return the row of the table in which a case counts: its lowest layer, or `harmless`."""
    return min(case.layers, key=LAYERS.index, default="harmless")
