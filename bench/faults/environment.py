"""Faults of the variables that decide which graph a shell or a unit joins."""

from __future__ import annotations

import random

from bench.faults.fault import ADDRESSES, LAPTOP, ROBOT, SERVER_PORT, STACK_UNITS, Effect, Fault, Step, drop_in, harmless

DDS_VARIABLES = ("ROS_DISCOVERY_SERVER", "FASTRTPS_DEFAULT_PROFILES_FILE")


def unset_variables(rng: random.Random) -> Fault:
    """Variables that the operator's shell should have."""
    names = rng.choice((DDS_VARIABLES, DDS_VARIABLES[:1], DDS_VARIABLES[1:]))
    # One of both is enough for a participant to reach the server.
    effect = Effect.BREAKS if len(names) == 2 else Effect.MAY_BREAK
    text = f"laptop: the shell has no {' and no '.join(names)}"
    return Fault("unset", text, "dds", "environment", LAPTOP, effect, variables=tuple((name, None) for name in names))


def edit_variable(rng: random.Random) -> Fault:
    """A variable of the operator's shell with a value that leads elsewhere."""
    name, value, effect = rng.choice(
        (
            ("ROS_DOMAIN_ID", str(rng.randrange(1, 100)), Effect.MAY_BREAK),
            ("ROS_DISCOVERY_SERVER", f"10.42.0.{rng.randrange(3, 250)}:{SERVER_PORT}", Effect.MAY_BREAK),
            ("ROS_DISCOVERY_SERVER", f"{ADDRESSES[ROBOT]}:{SERVER_PORT + rng.randrange(1, 50)}", Effect.MAY_BREAK),
            ("FASTRTPS_DEFAULT_PROFILES_FILE", f"/nowhere/{rng.randrange(10**6)}.xml", Effect.MAY_BREAK),
            ("RMW_IMPLEMENTATION", rng.choice(("rmw_cyclonedds_cpp", "rmw_zenoh_cpp")), Effect.BREAKS),
            ("FASTDDS_BUILTIN_TRANSPORTS", rng.choice(("SHM", "UDPv6")), Effect.BREAKS),
            ("ROS_LOCALHOST_ONLY", "1", Effect.MAY_BREAK),
        )
    )
    return Fault("edit", f"laptop: {name}={value}", "dds", "environment", LAPTOP, effect, variables=((name, value),))


def shadow_library(rng: random.Random) -> Fault:
    """A folder of other libraries that the operator's shell puts first: no ROS program starts in it."""
    folder = f"/tmp/lib{rng.randrange(10**6)}"
    make = f"mkdir -p {folder}/rclpy\nprintf 'raise ImportError(\"another rclpy\")\\n' > {folder}/rclpy/__init__.py"
    step = Step(LAPTOP, make, f"rm -r {folder}")
    variables = (("PYTHONPATH", folder),)
    text = f"laptop: PYTHONPATH={folder} with another rclpy"
    return Fault("edit", text, "dds", "environment", LAPTOP, Effect.BREAKS, (step,), variables=variables)


def edit_unused_variable(rng: random.Random) -> Fault:
    """A variable without influence on the graph."""
    name, value = rng.choice(
        (
            *(("LANG", "de_DE.UTF-8"), ("EDITOR", "ed"), ("RCUTILS_COLORIZED_OUTPUT", "1"), ("ROS_VERSION", "2")),
            *((f"LUPIN_UNUSED_{rng.randrange(100)}", "1"), ("COLUMNS", str(rng.randrange(20, 300))), ("ROS_DOMAIN_ID", "0")),
        )
    )
    return harmless("edit", f"laptop: {name}={value}", variables=((name, value),))


def edit_unit_environment(rng: random.Random) -> Fault:
    """A variable that leads a unit of the robot to another graph."""
    unit = rng.choice(STACK_UNITS)
    name, value, effect = rng.choice(
        (
            ("ROS_DOMAIN_ID", str(rng.randrange(1, 100)), Effect.MAY_BREAK),
            ("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp", Effect.BREAKS),
            ("ROS_LOCALHOST_ONLY", "1", Effect.MAY_BREAK),
        )
    )
    return drop_in("edit", unit, f"[Service]\\nEnvironment={name}={value}", "environment", f"{name}={value}", effect)
