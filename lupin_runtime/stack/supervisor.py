"""Starts, monitors, restarts and stops the processes of a run. Starts wait for readiness conditions, never for a fixed time."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any, BinaryIO, Protocol

from lupin_runtime.atomic_file import write_atomically
from lupin_runtime.interpreter import PYTHON
from lupin_runtime.stack.liveness import Liveness
from lupin_runtime.stack.log_lines import cause_in_log
from lupin_runtime.stack.options import Options
from lupin_runtime.stack.readiness import Readiness
from lupin_runtime.stack.runs import PROCESS_UMASK, Run
from lupin_runtime.stack.stage import LIVENESS_FAILED, Death, Phase, Stage
from lupin_runtime.stack.table import Launch, launch, rows
from lupin_runtime.stack.takeover import holder_of
from lupin_runtime.stack.usage import cpu_time_s, descendants_by_pid, memory_mb, start_ticks

STOP_GRACE_S = 4.0
RESTARTS_ALLOWED, RESTARTS_WITHIN_S = 3, 60.0
USAGE_PERIOD_S = 2.0
LOG_MAX_BYTES = 20_000_000
_MAX_TOLD_DEATHS = 100  # the last ones, in the state that is written: a process that dies every minute must not fill it


class ReadinessMonitor(Protocol):
    """Tests readiness conditions for the supervisor; `GraphMonitor` is the one of a real graph."""

    def satisfied(self, condition: Readiness, /) -> bool:
        """Return whether the condition holds now."""

    def forget(self, condition: Readiness, /) -> None:
        """Drop what was observed of a condition, because its process has exited."""

    def explain(self, condition: Readiness) -> str:
        """Say what is still missing, for the operator."""


class NothingObserved:
    """The monitor of a supervisor that has not joined the graph yet."""

    def satisfied(self, _condition: Readiness) -> bool:
        """No condition is known to hold."""
        return False

    def forget(self, _condition: Readiness) -> None:
        """Nothing was observed."""

    def explain(self, condition: Readiness) -> str:
        """Return why the condition does not hold."""
        return f"{condition}: the supervisor joins the graph"


class Supervisor:
    """Runs the processes that `options` select, in `run` and `environment`. `step` is called in a loop and does not block."""

    def __init__(
        self,
        options: Options,
        run: Run,
        environment: Mapping[str, str],
        monitor: ReadinessMonitor,
        own_output: bool = False,
        usage_period_s: float = USAGE_PERIOD_S,
        retry_optional_s: float | None = None,
    ) -> None:
        """With `own_output`, processes write to this process's output, such as the system journal, instead of log files.

        `retry_optional_s` after an optional process was given up, it is started again: nobody may be there to do it.
        """
        self.options = options
        self._own_output = own_output
        self.run = run
        self._environment = {**environment, "PYTHONUNBUFFERED": "1", "PYTHONFAULTHANDLER": "1"}
        # One computing thread per process: a dozen processes share the cores, and thread pools would compete for them.
        for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
            self._environment.setdefault(name, "1")
        self.monitor: ReadinessMonitor = monitor
        self.started_s = time.monotonic()
        self.stages = [Stage(launch(row, options), since_s=self.started_s) for row in rows(options)]
        self.deaths: list[Death] = []
        self.memory_peak_mb = 0.0
        self.liveness = Liveness()
        self.liveness.start()
        self._usage_due_s, self._usage_period_s = 0.0, usage_period_s
        self._retry_optional_s = retry_optional_s
        self._stopping = False

    def stage(self, name: str) -> Stage | None:
        """Return the stage called `name`, or None."""
        return next((stage for stage in self.stages if stage.row.name == name), None)

    def step(self) -> None:
        """Update every stage once: start it when its needs are met, mark it as up, restart it when it has exited."""
        now = time.monotonic()
        self.liveness.record_main_loop_iteration()
        if self.liveness.has_failed and LIVENESS_FAILED not in self.deaths:
            self.deaths.append(LIVENESS_FAILED)
        hung = self.liveness.hung()
        for stage in self.stages:
            if stage.row.name in hung:
                silence = hung[stage.row.name]
                node = f" (node {silence.node})" if silence.node else ""
                self._kill(stage, f"did not respond for {silence.wall_s:.1f} s{node} and was killed")
            if self._is_taken_over(stage, now):
                continue
            if stage.phase is Phase.WAITING:
                if all(self.monitor.satisfied(condition) for condition in stage.row.needs):
                    self._start(stage, now)
            elif stage.phase is Phase.FAILED:
                if stage.row.optional and self._retry_optional_s and now - stage.since_s >= self._retry_optional_s:
                    stage.restart_count += 1
                    self._start(stage, now)
            elif stage.phase in (Phase.STARTING, Phase.UP):
                if stage.process is not None and stage.process.poll() is not None:
                    self._handle_exit(stage, now)
                elif stage.phase is Phase.STARTING and all(self.monitor.satisfied(s) for s in stage.row.ready):
                    stage.phase, stage.why = Phase.UP, ""
                    if stage.row.sends_heartbeats:
                        self.liveness.expect_heartbeats(stage.row.name)
                    stage.up_after_s = now - self.started_s if stage.up_after_s is None else stage.up_after_s
                elif self._is_stuck_replacement(stage, now):
                    self._kill(stage, f"was not up again within {stage.row.up_within_s:g} s and was killed")
        if now >= self._usage_due_s:
            self._usage_due_s = now + self._usage_period_s
            self._measure()

    @staticmethod
    def _is_stuck_replacement(stage: Stage, now: float) -> bool:
        """Whether a process that was up before does not come up again; one that never came up ends the run instead."""
        return stage.phase is Phase.STARTING and stage.up_after_s is not None and now - stage.since_s > stage.row.up_within_s

    def _is_taken_over(self, stage: Stage, now: float) -> bool:
        """Return whether a person's own process has the place of this stage; end the own process for it, orderly."""
        holder = holder_of(self.run, stage.row.name) if stage.row.may_be_replaced else None
        if holder is None and stage.taken_over_s is None:
            return False
        if stage.taken_over_s is None:
            stage.taken_over_s, stage.phase = now, Phase.STOPPED
            stage.why = f"replaced by process {holder}, which runs in the foreground"
            if stage.process is not None and stage.process.poll() is None:
                _terminate(stage.process)
        if stage.process is not None:
            if stage.process.poll() is None:
                if now - stage.taken_over_s > STOP_GRACE_S:
                    stage.process.kill()
                return True
            self.liveness.stop_monitoring(stage.row.name)
            stage.process = stage.start_ticks = None
            for condition in stage.row.ready:
                self.monitor.forget(condition)
        if holder is None:
            stage.taken_over_s, stage.phase, stage.since_s, stage.why = None, Phase.WAITING, now, ""
            return False
        # Nothing is started here, and nothing is late: the person sees what their process says.
        stage.since_s = now
        stage.phase = Phase.UP if all(self.monitor.satisfied(condition) for condition in stage.row.ready) else Phase.STARTING
        return True

    def _start(self, stage: Stage, now: float) -> None:
        stage.phase, stage.since_s, stage.cpu_seen = Phase.STARTING, now, None
        if stage.row.external:
            return
        arguments = self._arguments(stage.launch)
        with self._log(stage.row.name) as log:
            # For heartbeats; stays open while this process lives, and when it is closed the child exits.
            channel, standard_input = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            with standard_input:
                stage.process = subprocess.Popen(
                    [*PYTHON, *arguments],
                    stdin=standard_input.fileno(),
                    stdout=log,
                    stderr=subprocess.STDOUT,
                    env=dict(self._environment),
                    start_new_session=True,
                    umask=PROCESS_UMASK,
                )
        stage.start_ticks = start_ticks(stage.process.pid)
        may_block = not stage.was_given_up
        self.liveness.monitor(stage.row.name, stage.process.pid, channel, stage.row.commands_motion, may_block)

    def _arguments(self, launch: Launch) -> list[str]:
        """Return the interpreter's arguments. On a full disk, the last is the configuration itself instead of its file."""
        directory = self.run.path / "processes"
        text = "" if launch.config is None else json.dumps(launch.config, indent=1)
        try:
            directory.mkdir(mode=0o700, exist_ok=True)
            if text:
                write_atomically(directory / f"{launch.row.name}.json", text)
        except OSError:
            return [*launch.arguments[:-1], text] if text else launch.arguments
        return launch.arguments

    def _log(self, name: str) -> AbstractContextManager[BinaryIO | None]:
        """Return the log file of a process; None if it shares this process's output. A full disk costs the log."""
        if self._own_output:
            return nullcontext()
        flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC
        try:
            return os.fdopen(os.open(self.run.logs / f"{name}.log", flags, 0o600), "ab")
        except OSError:
            return Path(os.devnull).open("ab")

    @staticmethod
    def _kill(stage: Stage, why: str) -> None:
        """Kill a process; its exit is then handled like any other."""
        if stage.process is not None and not stage.killed_why:
            stage.killed_why = why
            stage.process.kill()

    def _handle_exit(self, stage: Stage, now: float) -> None:
        status = stage.killed_why or self._exit_text(stage)
        stage.killed_why = ""
        for condition in stage.row.ready:
            self.monitor.forget(condition)
        was_up = stage.up_after_s is not None
        # One that was never up is not restarted without end, however long each of its attempts takes.
        while was_up and stage.restarts and now - stage.restarts[0] > RESTARTS_WITHIN_S:
            stage.restarts.popleft()
        # Without a mission no other process depends on the lost state.
        repairable = stage.row.on_death == "restart" or (stage.row.on_death == "mission" and not self.options.mission)
        may_restart = repairable and len(stage.restarts) < RESTARTS_ALLOWED
        if may_restart:
            stage.restarts.append(now)
            stage.restart_count += 1
            consequence = "restarted"
            self._start(stage, now)
        else:
            self.liveness.stop_monitoring(stage.row.name)
            stage.phase, stage.since_s, stage.was_given_up = Phase.FAILED, now, True
            lost = f"its state is lost, so the {stage.row.on_death} was stopped"
            given_up = f"given up after {RESTARTS_ALLOWED} restarts " + ("in a minute" if was_up else "without being up")
            consequence = given_up if repairable else lost
            if stage.row.optional and self._retry_optional_s:
                consequence += f"; it is started again in {self._retry_optional_s:.0f} s"
        log = "" if self._own_output else f"; log: {self.run.logs / (stage.row.name + '.log')}"
        stage.why = f"{status}; {consequence}{log}"
        self.deaths.append(Death(stage.row.name, status, consequence, ends_run=not (may_restart or stage.row.optional)))

    def _exit_text(self, stage: Stage) -> str:
        """Return how a process has exited; for one that failed by itself, also what its log says about the cause."""
        returncode = stage.process.returncode if stage.process is not None else 0
        if returncode < 0:
            return f"was killed by {signal.Signals(-returncode).name}"
        cause = cause_in_log(self.run.logs / f"{stage.row.name}.log") if returncode and not self._own_output else ""
        return f"exited with status {returncode}" + (f": {cause}" if cause else "")

    def waiting_for(self, stage: Stage) -> list[str]:
        """Return why each condition for a stage's next phase does not hold."""
        conditions = {Phase.WAITING: stage.row.needs, Phase.STARTING: stage.row.ready}.get(stage.phase, ())
        return [self.monitor.explain(condition) for condition in conditions if not self.monitor.satisfied(condition)]

    def all_up(self, names: Sequence[str] | None = None) -> bool:
        """Return whether the stages called `names`, or all that a run needs, are up."""
        chosen = [s for s in self.stages if (not s.row.optional if names is None else s.row.name in names)]
        return all(stage.phase is Phase.UP for stage in chosen)

    def stalled(self) -> list[Stage]:
        """Return the needed stages that failed or are not up in time; if there are none, those that have waited too long."""
        now = time.monotonic()
        needed = [stage for stage in self.stages if not stage.row.optional]
        late = [
            stage
            for stage in needed
            if stage.phase is Phase.FAILED or (stage.phase is Phase.STARTING and now - stage.since_s > stage.row.up_within_s)
        ]
        if late:
            return late
        start_bound_s = 2.0 * max((stage.row.up_within_s for stage in self.stages), default=0.0)
        return [s for s in needed if s.phase is Phase.WAITING and now - s.since_s > start_bound_s]

    def _measure(self) -> None:
        total = memory_mb("self") or 0.0
        descendants = descendants_by_pid()
        for stage in self.stages:
            if stage.process is None or stage.phase not in (Phase.STARTING, Phase.UP):
                stage.cpu_percent = stage.memory_mb = 0.0
                continue
            used_s, memory = cpu_time_s(stage.process.pid), memory_mb(stage.process.pid)
            if used_s is None or memory is None:
                continue
            memory += sum(memory_mb(pid) or 0.0 for pid in descendants(stage.process.pid))
            now = time.monotonic()
            if stage.cpu_seen is not None:
                since_s, before_s = stage.cpu_seen
                stage.cpu_percent = 100.0 * (used_s - before_s) / (now - since_s)
            stage.cpu_seen, stage.memory_mb = (now, used_s), memory
            if memory > stage.row.memory_max_mb:
                self._kill(stage, f"used {memory:.0f} MB, its limit is {stage.row.memory_max_mb} MB, and was killed")
            if not self._own_output:
                shorten_log(self.run.logs / f"{stage.row.name}.log")
            total += memory
        self.memory_peak_mb = max(self.memory_peak_mb, total)

    def stop(self) -> None:
        """Stop every process in the order of `stop_rank`; each rank gets STOP_GRACE_S, then it is killed."""
        self._stopping = True
        for rank in sorted({stage.row.stop_rank for stage in self.stages}):
            stopping = [stage for stage in self.stages if stage.row.stop_rank == rank and stage.process is not None]
            for stage in stopping:
                if stage.process is not None and stage.process.poll() is None:
                    _terminate(stage.process)
            deadline = time.monotonic() + STOP_GRACE_S
            for stage in stopping:
                self._reap(stage, deadline)
        self.liveness.close()

    def _reap(self, stage: Stage, deadline: float) -> None:
        process = stage.process
        if process is None:
            return
        try:
            process.wait(max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait(STOP_GRACE_S)
            stage.why = "killed: it did not stop in time"
        self.liveness.stop_monitoring(stage.row.name)
        if stage.phase is not Phase.FAILED:
            stage.phase = Phase.STOPPED

    def snapshot(self) -> dict[str, Any]:
        """Return the state of the run as plain data, for `state.json` and the live view."""
        reasons = self.liveness.motion_block_reasons()
        return {
            "monotonic_s": round(time.monotonic(), 2),  # a reader sees by it whether the supervisor still responds
            "pid": os.getpid(),
            "age_s": round(time.monotonic() - self.started_s, 2),
            "stages": [
                {
                    "name": stage.row.name,
                    "engine": stage.row.engine,
                    "phase": stage.phase.value,
                    "optional": stage.row.optional,
                    "pid": stage.process.pid if stage.process is not None else None,
                    "start_ticks": stage.start_ticks,
                    "trouble": reasons.get(stage.row.name, ""),
                    "up_after_s": stage.up_after_s,
                    "waiting_for": self.waiting_for(stage),
                    "waiting_s": round(time.monotonic() - stage.since_s, 1)
                    if stage.phase in (Phase.WAITING, Phase.STARTING)
                    else None,
                    "cpu_percent": round(stage.cpu_percent, 1),
                    "memory_mb": round(stage.memory_mb, 1),
                    "restarts": stage.restart_count,
                    "why": stage.why,
                }
                for stage in self.stages
            ],
            "deaths": [death.__dict__ for death in self.deaths[-_MAX_TOLD_DEATHS:]],
            "memory_peak_mb": round(self.memory_peak_mb, 1),
        }


def _terminate(process: subprocess.Popen[bytes]) -> None:
    process.send_signal(signal.SIGTERM)
    process.send_signal(signal.SIGCONT)  # a process that SIGSTOP suspended handles SIGTERM only after it


def shorten_log(path: Path) -> None:
    """Move a log that exceeds LOG_MAX_BYTES to NAME.log.1; its process, which appends, continues with an empty one."""
    try:
        if path.stat().st_size > LOG_MAX_BYTES:
            shutil.copy(path, path.with_name(path.name + ".1"))
            os.truncate(path, 0)
    except OSError:
        pass  # a full disk: the log stays as it is
