"""`python -m lupin_sim`: the simulated robot as a process of the stack."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from lupin_sim.controllers import STATES
from lupin_sim.graph_claim import GraphTaken, claim_graph
from lupin_sim.wheels import DRIVES
from lupin_sim.world import World
from lupin_sim.worlds import WorldError, load_world


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m lupin_sim", description="A simulated MIRTE in a simulated greenhouse.")
    parser.add_argument("--world", default="demo", help="demo, course[:STRETCH], random:SEED, walled, or a layout file")
    parser.add_argument("--seed", type=int, default=0, help="seed of sensor noise and all other randomness")
    parser.add_argument("--speed", type=float, default=1.0, help="simulated seconds per second; 0 is as fast as possible")
    parser.add_argument("--wall-clock", action="store_true", help="stamp messages with this computer's clock, as a robot does")
    parser.add_argument("--no-cameras", action="store_true", help="render no camera images")
    parser.add_argument("--run-dir", default="", help="folder for truth.json, truth_trajectory.tum and sim_state.json")
    parser.add_argument("--fidelity", choices=sorted(DRIVES), default="ideal", help="how wheels follow their setpoints")
    parser.add_argument("--controllers", choices=STATES, default="active", help="initial state of the five controllers")
    parser.add_argument("--led-order", default="RGB", help="the color that each byte of the LED strip's protocol drives")
    return parser.parse_args(argv)


def main(argv: list[str] | None = None) -> int:
    """Run until SIGTERM or SIGINT. Returns 0, 1 after a failure or beside another simulator, 2 for invalid arguments."""
    arguments = _arguments(argv)
    # MuJoCo and rclpy take half a second to import, so they are imported after the checks.
    try:
        world = load_world(arguments.world, arguments.seed)
    except WorldError as error:
        print(f"lupin_sim: {error}", file=sys.stderr)
        return 2
    try:
        claim = claim_graph()  # held until this process exits
    except GraphTaken as error:
        print(f"lupin_sim: {error}", file=sys.stderr)
        return 1
    with claim:
        return _simulate(arguments, world)


def _simulate(arguments: argparse.Namespace, world: World) -> int:
    from lupin_runtime.ros import run
    from lupin_runtime.ros.supervision import Supervision
    from lupin_sim.engine import Simulation
    from lupin_sim.node import SimulatedRobot

    supervision = Supervision()
    supervision.start()
    try:
        simulation = Simulation(world, arguments.seed, arguments.fidelity, arguments.controllers, led_order=arguments.led_order)
    except ValueError as error:
        print(f"lupin_sim: {error}", file=sys.stderr)
        return 2
    if arguments.run_dir:
        try:
            Path(arguments.run_dir).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            print(f"lupin_sim: --run-dir {arguments.run_dir} cannot be created: {error.strerror}", file=sys.stderr)
            return 2
    robots: list[SimulatedRobot] = []

    def make_robot() -> SimulatedRobot:
        parameters: dict[str, Any] = {
            "speed": arguments.speed,
            "cameras": not arguments.no_cameras,
            "run_dir": arguments.run_dir,
            "wall_clock": arguments.wall_clock,
        }
        robots.append(SimulatedRobot(simulation, parameters))
        return robots[0]

    status = run([make_robot], ready=lambda _: robots[0].start(), supervision=supervision)
    return 1 if any(robot.failed for robot in robots) else status


if __name__ == "__main__":
    sys.exit(main())
