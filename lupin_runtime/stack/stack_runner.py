"""One execution of `lupin up`: bring-up, mission, shutdown. It prints nothing; a view observes its state."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from lupin_runtime.exit_codes import FAILURE, INTERRUPTED, SUCCESS, UNREACHABLE
from lupin_runtime.mission.overrides import OVERRIDES_NAME, load_overrides, save_overrides
from lupin_runtime.safety.estop_monitor import ESTOP_ENGAGED
from lupin_runtime.stack.alarms import alarms
from lupin_runtime.stack.dds import GRAPH_VARIABLES, DomainClaim, claim_domain, loopback_environment, robot_environment
from lupin_runtime.stack.mission_events import mission_clock_s
from lupin_runtime.stack.mission_start import MissionStart
from lupin_runtime.stack.options import Options
from lupin_runtime.stack.retention import remove_old_runs
from lupin_runtime.stack.runs import Run, RunError, create_run
from lupin_runtime.stack.shm import disable_lttng_shm
from lupin_runtime.stack.stage import Phase
from lupin_runtime.stack.state_file import StateFile, unwritable
from lupin_runtime.stack.supervisor import Supervisor
from lupin_runtime.stack.usage import start_ticks

STEP_S = 0.1
STATE_PERIOD_S = 1.0
MISSION_SILENCE_S = 15.0


@dataclass
class Outcome:
    """How a run ended: its exit status, a state for scripts, and one sentence for the operator."""

    exit_status: int = INTERRUPTED
    state: str = "INTERRUPTED"
    sentence: str = "interrupted"
    failed_process: str = ""  # its log says more
    drivable_s: float | None = None
    ready_s: float | None = None
    wall_time_s: float = 0.0
    memory_mb: float = 0.0
    mission: dict[str, Any] = field(default_factory=dict)
    stages: list[dict[str, Any]] = field(default_factory=list)
    deaths: list[dict[str, Any]] = field(default_factory=list)


def mission_facts(message: Any) -> dict[str, Any]:
    """Return the fields of a MissionState message that views and scripts show; empty for None."""
    if message is None:
        return {}
    names = (
        "mission_id mission_type lifecycle_state mission_phase current_target targets_total targets_completed "
        "targets_failed targets_unreachable targets_skipped last_error last_event tags_discovered discovery_goal "
        "estop_engaged paused battery_percentage battery_low"
    )
    return {**{name: getattr(message, name) for name in names.split()}, "clock_s": mission_clock_s(message)}


class StackRunner:
    """A run of the stack: the supervisor, the graph monitor, and the requested mission.

    `observe(state)` is called about ten times a second with the data that is also written to `state.json`.
    """

    def __init__(self, options: Options, observe: Callable[[dict[str, Any]], None]) -> None:
        self.run: Run
        self.run, self._lock = create_run()
        remove_old_runs()
        self.options = options.in_folder(self.run.path)
        self._observe = observe
        self._domain: DomainClaim | None = None
        self.applied: list[str] = []
        try:
            self._prepare(options)
        except OSError as error:  # nothing runs yet
            raise RunError(f"{unwritable(self.run, error)}, or set XDG_STATE_HOME") from error
        # Imported here, because rclpy reads the environment when it is first imported and initialized.
        from lupin_runtime.stack.graph_monitor import GraphMonitor
        from lupin_runtime.stack.robot_tracker import RobotTracker

        self.monitor = GraphMonitor()
        self.tracker = RobotTracker(self.monitor.node)
        self.supervisor = Supervisor(self.options, self.run, dict(os.environ), self.monitor)
        self.outcome = Outcome()
        self._state_file = StateFile(self.run)
        self._state_due_s = 0.0
        self._alarms: list[str] = []
        self._start = MissionStart(
            self.monitor.can_start_mission,
            lambda answered: self.monitor.start_mission("ExplorationMission", self.options.discovery_goal, answered),
        )
        self._interrupted = False

    def _prepare(self, options: Options) -> None:
        """Select the run's graph, and write what other commands need to know of the run. Raises OSError."""
        # The console changes the run's copy, never the operator's file.
        overrides = load_overrides(options.approach_overrides) if options.approach_overrides else {}
        save_overrides(self.run.path / OVERRIDES_NAME, overrides)
        if options.simulated:
            self._domain = claim_domain()
            environment = loopback_environment(self._domain.domain, self.run.path)
        else:
            environment, self.applied = robot_environment()
        os.environ.clear()
        os.environ.update(environment)
        disable_lttng_shm()
        self.run.write_info(
            {
                "id": self.run.id,
                "pid": os.getpid(),
                "start_ticks": start_ticks(os.getpid()),
                "started": time.time(),
                "checkout": str(Path(__file__).resolve().parents[2]),
                "domain": self._domain.domain if self._domain is not None else None,
                "environment": {key: environment[key] for key in GRAPH_VARIABLES if key in environment},
                "options": self.options.as_json(),
            }
        )

    def execute(self) -> Outcome:
        """Run until the mission ends, a stage fails to come up, or a signal arrives; then stop every process."""
        numbers = [signal.SIGINT, signal.SIGTERM]
        if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # it is for a run that was started by nohup
            numbers.append(signal.SIGHUP)
        before = {number: signal.signal(number, self._interrupt) for number in numbers}
        try:
            while not self._interrupted and not self._ended():
                self.monitor.spin(STEP_S)
                self.supervisor.step()
                self._update_progress()
                self._report_state()
        finally:
            self._finish()
            for number, handler in before.items():
                signal.signal(number, handler)
        return self.outcome

    def _interrupt(self, *_: object) -> None:
        # Raises nothing: the signal may arrive at any point, also while a run that has ended by itself stops its processes.
        self._interrupted = True

    def _update_progress(self) -> None:
        age = time.monotonic() - self.supervisor.started_s
        needed = [stage.row.name for stage in self.supervisor.stages if stage.row.needed_to_drive]
        if self.outcome.drivable_s is None and needed and self.supervisor.all_up(needed):
            self.outcome.drivable_s = round(age, 2)
        if not self.options.mission:
            return
        if self.outcome.ready_s is None and self.supervisor.all_up():
            self.outcome.ready_s = round(age, 2)
        monitor, all_up = self.monitor, self.outcome.ready_s is not None
        self._start.step(time.monotonic(), monitor.mission, monitor.was_pressed, monitor.estop_waits, all_up)

    def _ended(self) -> bool:
        outcome = self.outcome
        fatal = next((death for death in self.supervisor.deaths if death.ends_run), None)
        if fatal is not None:
            outcome.exit_status, outcome.state = FAILURE, "LOST"
            outcome.sentence = f"{fatal.stage} {fatal.status}; {fatal.consequence}"
            outcome.failed_process = fatal.stage
            if outcome.ready_s is None and self._is_late():
                outcome.exit_status = UNREACHABLE
            return True
        if self._is_late():
            outcome.exit_status, outcome.state = UNREACHABLE, "NEVER_UP"
            stage = self.supervisor.stalled()[0]
            outcome.failed_process = stage.row.name
            waits = "; ".join(self.supervisor.waiting_for(stage)) or stage.why
            advice = f"; find the cause with: {stage.row.next_command}" if stage.row.next_command else ""
            outcome.sentence = f"{stage.row.name} did not come up: {waits}{advice}"
            return True
        if self._start.refusal:
            outcome.exit_status, outcome.state = FAILURE, "REFUSED"
            outcome.sentence = f"the mission was refused: {self._start.refusal}"
            return True
        return self._mission_ended()

    def _is_late(self) -> bool:
        never_up = [stage for stage in self.supervisor.stalled() if stage.up_after_s is None]
        return bool(never_up)

    def _mission_ended(self) -> bool:
        message, outcome = self.monitor.mission, self.outcome
        if not self._start.mission_id or message is None:
            return False
        if time.monotonic() - self.monitor.mission_received_s > MISSION_SILENCE_S:
            outcome.exit_status, outcome.state = FAILURE, "LOST"
            outcome.sentence = f"the mission has published no state for {MISSION_SILENCE_S:.0f} s; see: lupin logs mission"
            return True
        if message.mission_id != self._start.mission_id or message.lifecycle_state not in ("DONE", "FAULT"):
            return False
        outcome.state = message.lifecycle_state
        outcome.exit_status = SUCCESS if outcome.state == "DONE" else FAILURE
        detail = f" ({message.last_event or message.last_error})" if message.last_error else ""
        outcome.sentence = f"mission {outcome.state}{detail}"
        return True

    def state(self) -> dict[str, Any]:
        """Return the state of the whole run as plain data."""
        return {
            **self.supervisor.snapshot(),
            "id": self.run.id,
            "rates_hz": self.monitor.rates_hz(),
            "silent_s": self.monitor.silent_s(),
            "alarms": [*self.monitor.alarms, *self._remote_alarms(), *filter(None, [self._state_file.problem])],
            "mission": mission_facts(self.monitor.mission),
            "events": list(self.monitor.mission_events.entries),
            "robot": self.tracker.look(),
            "drivable_s": self.outcome.drivable_s,
            "ready_s": self.outcome.ready_s,
        }

    def _remote_alarms(self) -> list[str]:
        """What keeps a robot's drive bus locked, and what it no longer publishes: its processes are supervised there."""
        if self.options.target != "robot":
            return []
        locks = [f"the drive bus is locked: {lock}" for lock in self.monitor.drive_bus_locks if lock != ESTOP_ENGAGED]
        silent = [f"nothing on {topic} for {age_s:.0f} s" for topic, age_s in self.monitor.silent_s().items()]
        return locks + silent

    def _report_state(self) -> None:
        state = self.state()
        self._observe(state)
        current = alarms(state)
        if time.monotonic() >= self._state_due_s or current != self._alarms:
            self._state_due_s = time.monotonic() + STATE_PERIOD_S
            self._alarms = current
            self._state_file.write(state)

    def _finish(self) -> None:
        outcome = self.outcome
        outcome.wall_time_s = round(time.monotonic() - self.supervisor.started_s, 1)
        outcome.mission = mission_facts(self.monitor.mission)
        outcome.stages = [
            {**stage, "phase": Phase.STOPPED.value if stage["phase"] == Phase.UP.value else stage["phase"]}
            for stage in self.supervisor.snapshot()["stages"]
        ]
        outcome.deaths = [dict(death.__dict__) for death in self.supervisor.deaths]
        self.supervisor.stop()
        self.monitor.close()
        outcome.memory_mb = round(self.supervisor.memory_peak_mb, 1)
        self._state_file.write({**self.state_after_end(), "outcome": asdict(outcome)})
        if self._domain is not None:
            self._domain.release()

    def state_after_end(self) -> dict[str, Any]:
        """Return the last state of an ended run."""
        return {"id": self.run.id, "pid": os.getpid(), "mission": self.outcome.mission, "stages": self.outcome.stages}
