"""The simulated robot as a ROS node: one thread steps and renders the world, the executor's thread handles commands."""

from __future__ import annotations

import os
import signal
import threading
import traceback
from pathlib import Path
from typing import Any

from std_msgs.msg import String

from lupin_runtime import graph
from lupin_runtime.ros import LupinNode
from lupin_sim.cameras import CameraRig, GraphicsUnavailable
from lupin_sim.engine import Simulation
from lupin_sim.pacing import Pacer
from lupin_sim.publishing import Stamps, StatePublishers, camera_publishers, new_camera_rig
from lupin_sim.sensor_faults import InvalidFault, SensorFaults
from lupin_sim.truth import TruthRecorder
from lupin_sim.vendor import VendorInterface

STOP_WAIT_S = 2.0
# Shorter sleeps are skipped, because they cost more than they save; the pacer's anchor keeps the clock correct.
SHORTEST_SLEEP_S = 0.001


class SimulatedRobot(LupinNode):
    """A simulated MIRTE on the ROS graph.

    Parameters: `speed` (1.0; 0 for as fast as possible), `cameras` (true), `run_dir` ("" for none), `wall_clock` (false:
    simulated time, published on /clock; true: stamps from this computer's clock, and a robot's topics for the body camera).
    """

    def __init__(self, simulation: Simulation, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("mirte", parameters)
        self.simulation = simulation
        self.failed = False
        self._speed = self.parameter("speed", 1.0)
        self._cameras_enabled = self.parameter("cameras", True)
        run_dir = self.parameter("run_dir", "")
        self._faults = SensorFaults()
        stamps = Stamps(simulation, self._faults, self.parameter("wall_clock", False))
        self._recorder = TruthRecorder(simulation, Path(run_dir), stamps.true_s) if run_dir else None
        self._state_topics = StatePublishers(self, stamps)
        self._camera_topics = camera_publishers(self, stamps) if self._cameras_enabled else ()
        self.subscription(graph.SIM_FAULT, self._set_fault)
        self._vendor = VendorInterface(self, simulation)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="simulation", daemon=True)
        self._stalled_servos: frozenset[str] = frozenset()

    def start(self) -> None:
        """Start simulated time."""
        self._state_topics.announce()
        self._thread.start()

    def before_shutdown(self) -> None:
        """Stop the simulation and wait for its thread."""
        self._stop.set()
        self._thread.join(STOP_WAIT_S)

    def _run(self) -> None:
        rig = None
        try:
            rig = self._renderer()
            self._loop(rig)
        except BaseException:
            # Without its simulation the process would look alive and publish nothing: report the error and terminate it.
            traceback.print_exc()
            self.failed = True
            os.kill(os.getpid(), signal.SIGTERM)
        finally:
            self._close_recorder()
            if rig is not None:
                rig.close()

    def _close_recorder(self) -> None:
        if self._recorder is not None:
            try:
                self._recorder.close()
            except OSError as error:
                self.get_logger().error(f"the end of the ground truth could not be written: {error}")

    def _renderer(self) -> CameraRig | None:
        if not self._cameras_enabled:
            return None
        try:
            return new_camera_rig(self.simulation.model)
        except GraphicsUnavailable as missing:
            self.get_logger().warning(str(missing))
            return None

    def _loop(self, rig: CameraRig | None) -> None:
        simulation, pacer = self.simulation, Pacer(self._speed)
        pacer.start(simulation.time_s)
        while not self._stop.is_set():
            simulation.step()
            self._state_topics.publish_due()
            if rig is not None:
                for camera in self._camera_topics:
                    camera.publish_due(rig)
            self._record(pacer.real_time_factor(simulation.time_s))
            self._report_stalls()
            wait_s = pacer.wait_s(simulation.time_s)
            if wait_s > SHORTEST_SLEEP_S:
                self._stop.wait(wait_s)

    def _record(self, real_time_factor: float) -> None:
        if self._recorder is None:
            return
        try:
            self._recorder.update(real_time_factor)
        except OSError as error:
            # A full disk prevents a score; the robot keeps running.
            self.get_logger().error(f"the ground truth is no longer recorded: {error}")
            self._recorder = None

    def _set_fault(self, message: String) -> None:
        try:
            self._faults.apply(message.data)
        except InvalidFault as error:
            self.get_logger().warning(str(error))

    def _report_stalls(self) -> None:
        stalled = frozenset(self.simulation.servos.stalled)
        for servo in sorted(stalled - self._stalled_servos):
            self.get_logger().warning(f"servo {servo} is stalled: more than 0.10 rad off for over a second")
        self._stalled_servos = stalled
