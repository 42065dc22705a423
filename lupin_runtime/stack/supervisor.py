"""Starts, watches, restarts and stops the processes of a run. It never sleeps on a guess: stages wait for sentinels."""

from __future__ import annotations

import enum
import json
import os
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, Protocol

from lupin_runtime.stack.runs import Run
from lupin_runtime.stack.sentinels import Sentinel
from lupin_runtime.stack.table import Launch, Options, ProcessRow, launch, rows
from lupin_runtime.stack.usage import cpu_time_s, memory_mb

STOP_GRACE_S = 4.0
RESTARTS_ALLOWED, RESTARTS_WITHIN_S = 3, 60.0
USAGE_PERIOD_S = 2.0


class Watch(Protocol):
    """What the supervisor asks of the graph."""

    def satisfied(self, sentinel: Sentinel) -> bool: ...

    def forget(self, sentinel: Sentinel) -> None: ...

    def explain(self, sentinel: Sentinel) -> str: ...


class Phase(enum.Enum):
    """Where a process is between being wanted and being up."""

    WAITING = "waiting"
    STARTING = "starting"
    UP = "up"
    FAILED = "failed"
    STOPPED = "stopped"


@dataclass
class Stage:
    """One process of the run, as it stands."""

    launch: Launch
    phase: Phase = Phase.WAITING
    since_s: float = 0.0
    up_after_s: float | None = None
    process: subprocess.Popen[bytes] | None = None
    restarts: deque[float] = field(default_factory=deque)
    restart_count: int = 0
    why: str = ""
    cpu_percent: float = 0.0
    memory_mb: float = 0.0
    cpu_seen: tuple[float, float] | None = None  # when, s, and the processor time used until then, s

    @property
    def row(self) -> ProcessRow:
        """The stage's row of the table."""
        return self.launch.row


@dataclass(frozen=True)
class Death:
    """A process ended that nobody asked to end."""

    stage: str
    status: str
    consequence: str


class Supervisor:
    """Runs the rows of `options` inside `run`, in `environment`; `step` moves it on and never blocks for long."""

    def __init__(
        self, options: Options, run: Run, environment: Mapping[str, str], watch: Watch, own_output: bool = False
    ) -> None:
        """With `own_output` the processes write where this one does, a journal say, and not into files of the run."""
        self.options = options
        self._own_output = own_output
        self.run = run
        self._environment = {**environment, "PYTHONUNBUFFERED": "1", "PYTHONFAULTHANDLER": "1"}
        # Every process computes on one thread: twelve of them share the cores, and thread pools only fight over them.
        for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
            self._environment.setdefault(name, "1")
        self._watch = watch
        self.started_s = time.monotonic()
        self.stages = [Stage(launch(row, options), since_s=self.started_s) for row in rows(options)]
        self.deaths: list[Death] = []
        self.memory_peak_mb = 0.0
        self._usage_due_s = 0.0
        self._stopping = False

    def stage(self, name: str) -> Stage | None:
        """The stage of this name, where the run has one."""
        return next((stage for stage in self.stages if stage.row.name == name), None)

    def step(self) -> None:
        """Look at every stage once: start what may start, notice what is up, restart what died."""
        now = time.monotonic()
        for stage in self.stages:
            if stage.phase is Phase.WAITING:
                if all(self._watch.satisfied(sentinel) for sentinel in stage.row.needs):
                    self._start(stage, now)
            elif stage.phase in (Phase.STARTING, Phase.UP):
                if stage.process is not None and stage.process.poll() is not None:
                    self._bury(stage, now)
                elif stage.phase is Phase.STARTING and all(self._watch.satisfied(s) for s in stage.row.ready):
                    stage.phase, stage.why = Phase.UP, ""
                    stage.up_after_s = now - self.started_s if stage.up_after_s is None else stage.up_after_s
        if now >= self._usage_due_s:
            self._usage_due_s = now + USAGE_PERIOD_S
            self._measure()

    def _start(self, stage: Stage, now: float) -> None:
        stage.phase, stage.since_s, stage.cpu_seen = Phase.STARTING, now, None
        if stage.row.elsewhere:
            return
        directory = self.run.path / "processes"
        directory.mkdir(exist_ok=True)
        if stage.launch.config is not None:
            (directory / f"{stage.row.name}.json").write_text(json.dumps(stage.launch.config, indent=1))
        with self._log(stage.row.name) as log:
            stage.process = subprocess.Popen(
                [sys.executable, *stage.launch.arguments],
                stdin=subprocess.PIPE,  # held open for as long as we live: its end is how a child learns of our death
                stdout=log,
                stderr=subprocess.STDOUT,
                env=dict(self._environment),
                start_new_session=True,
            )

    def _log(self, name: str) -> AbstractContextManager[BinaryIO | None]:
        """Where a process's words go: its file of the run, or with None where ours go."""
        return nullcontext() if self._own_output else (self.run.logs / f"{name}.log").open("ab")

    def _bury(self, stage: Stage, now: float) -> None:
        status = _describe(stage.process.returncode if stage.process else None)
        for sentinel in stage.row.ready:
            self._watch.forget(sentinel)
        while stage.restarts and now - stage.restarts[0] > RESTARTS_WITHIN_S:
            stage.restarts.popleft()
        # Without a mission nothing depends on what a process of one knew.
        repairable = stage.row.on_death == "restart" or (stage.row.on_death == "mission" and not self.options.mission)
        may_restart = repairable and len(stage.restarts) < RESTARTS_ALLOWED
        if may_restart:
            stage.restarts.append(now)
            stage.restart_count += 1
            consequence = "restarted"
            self._close_input(stage)
            self._start(stage, now)
        else:
            stage.phase = Phase.FAILED
            lost = f"the {stage.row.on_death} ends: what it knew is gone"
            consequence = "given up after 3 restarts in a minute" if repairable else lost
        log = "" if self._own_output else f"; log: {self.run.logs / (stage.row.name + '.log')}"
        stage.why = f"{status}; {consequence}{log}"
        self.deaths.append(Death(stage.row.name, status, consequence))

    @staticmethod
    def _close_input(stage: Stage) -> None:
        if stage.process is not None and stage.process.stdin is not None:
            stage.process.stdin.close()

    def waiting_for(self, stage: Stage) -> list[str]:
        """What keeps a stage from its next phase, in words."""
        sentinels = {Phase.WAITING: stage.row.needs, Phase.STARTING: stage.row.ready}.get(stage.phase, ())
        return [self._watch.explain(sentinel) for sentinel in sentinels if not self._watch.satisfied(sentinel)]

    def all_up(self, names: Sequence[str] | None = None) -> bool:
        """Whether these stages, or all, are up."""
        return all(stage.phase is Phase.UP for stage in self.stages if names is None or stage.row.name in names)

    def stalled(self) -> list[Stage]:
        """Stages past their bound, the roots first: those that started and never came up, then those still gated."""
        now = time.monotonic()
        late = [
            stage
            for stage in self.stages
            if stage.phase is Phase.FAILED or (stage.phase is Phase.STARTING and now - stage.since_s > stage.row.up_within_s)
        ]
        if late:
            return late
        gate_s = 2.0 * max((stage.row.up_within_s for stage in self.stages), default=0.0)
        return [s for s in self.stages if s.phase is Phase.WAITING and now - s.since_s > gate_s]

    def _measure(self) -> None:
        total = memory_mb("self") or 0.0
        for stage in self.stages:
            if stage.process is None or stage.phase not in (Phase.STARTING, Phase.UP):
                stage.cpu_percent = stage.memory_mb = 0.0
                continue
            used_s, memory = cpu_time_s(stage.process.pid), memory_mb(stage.process.pid)
            if used_s is None or memory is None:
                continue
            now = time.monotonic()
            if stage.cpu_seen is not None:
                since_s, before_s = stage.cpu_seen
                stage.cpu_percent = 100.0 * (used_s - before_s) / (now - since_s)
            stage.cpu_seen, stage.memory_mb = (now, used_s), memory
            total += memory
        self.memory_peak_mb = max(self.memory_peak_mb, total)

    def stop(self) -> None:
        """End every process: commanders first, the drive bus after them, the robot last. Bounded by the grace of each rank."""
        self._stopping = True
        for rank in sorted({stage.row.stop_rank for stage in self.stages}):
            ending = [stage for stage in self.stages if stage.row.stop_rank == rank and stage.process is not None]
            for stage in ending:
                if stage.process is not None and stage.process.poll() is None:
                    stage.process.send_signal(signal.SIGTERM)
                    # A stopped process cannot act on SIGTERM before it is continued.
                    stage.process.send_signal(signal.SIGCONT)
            deadline = time.monotonic() + STOP_GRACE_S
            for stage in ending:
                self._reap(stage, deadline)

    def _reap(self, stage: Stage, deadline: float) -> None:
        process = stage.process
        if process is None:
            return
        try:
            process.wait(max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait(STOP_GRACE_S)
            stage.why = "had to be killed"
        self._close_input(stage)
        if stage.phase is not Phase.FAILED:
            stage.phase = Phase.STOPPED

    def snapshot(self) -> dict[str, Any]:
        """The state of the run as plain data, for `state.json` and for views."""
        return {
            "pid": os.getpid(),
            "age_s": round(time.monotonic() - self.started_s, 2),
            "stages": [
                {
                    "name": stage.row.name,
                    "phase": stage.phase.value,
                    "pid": stage.process.pid if stage.process is not None else None,
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
            "deaths": [death.__dict__ for death in self.deaths],
            "memory_peak_mb": round(self.memory_peak_mb, 1),
        }


def _describe(returncode: int | None) -> str:
    if returncode is None:
        return "ended"
    if returncode < 0:
        return f"ended by {signal.Signals(-returncode).name}"
    return f"ended with status {returncode}"


def log_tail(path: Path, lines: int = 5) -> list[str]:
    """The last lines of a log, for an error message."""
    try:
        return path.read_text(errors="replace").splitlines()[-lines:]
    except OSError:
        return []
