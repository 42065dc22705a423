"""Faults of disk, shared memory and clock."""

from __future__ import annotations

import random

from bench.faults.fault import ENDS, HOST, ROBOT, Effect, Fault, Step, harmless

FILL_SHARED_MEMORY = "used=$(df --output=used -k /dev/shm | tail -n 1)\nmount -o remount,size=$((used + 4))k /dev/shm"


def fill_storage(rng: random.Random) -> Fault:
    """No space left: on the robot's disk, or in the shared memory of either end."""
    what = rng.choice(("disk", *ENDS))
    if what == "disk":
        step = Step(HOST, "disk-full", "disk-full")
        return Fault("fill", "robot: the disk", "disk", "machine", ROBOT, Effect.MAY_BREAK, (step,))
    step = Step(what, FILL_SHARED_MEMORY, f"mount -o remount,size={'256M' if what == ROBOT else '50%'} /dev/shm")
    return Fault("fill", f"{what}: /dev/shm", "memory", "machine", what, Effect.MAY_BREAK, (step,))


def fill_a_little(rng: random.Random) -> Fault:
    """A file that fits easily."""
    path, size = rng.choice(("/var/tmp", "/home/mirte", "/dev/shm")), rng.randrange(1, 20)
    file = f"{path}/notes-{rng.randrange(1000)}"
    return harmless("fill", f"robot: {size} MB in {path}", Step(ROBOT, f"head -c {size}M /dev/zero > {file}", f"rm -f {file}"))


def shift_clock(rng: random.Random) -> Fault:
    """The robot's clock, more than a second to an hour off."""
    offset_s = rng.choice((-1, 1)) * rng.choice((1.5, 2.2, 5.0, 30.0, 300.0, 3600.0))
    step = Step(HOST, f"clock-wrong offset_s={offset_s}", "clock-wrong")
    return Fault("shift", f"robot: clock by {offset_s:+g} s", "clock", "clock", ROBOT, Effect.BREAKS, (step,))


def shift_clock_a_little(rng: random.Random) -> Fault:
    """A crystal as good as any."""
    step = Step(HOST, f"clock-drifts ppm={rng.choice((-20.0, -5.0, 5.0, 20.0))}", "clock-drifts")
    return harmless("shift", f"robot: {step.make}", step)
