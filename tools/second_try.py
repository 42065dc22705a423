"""Run a stage of the tests; what fails in it is run again, alone, up to twice, and every such test is counted.

    python -m tools.second_try pytest STAGE [PYTEST'S ARGUMENTS]
    python -m tools.second_try playwright STAGE [FILE...]  # the page in Chromium; Playwright repeats tests itself
    python -m tools.second_try judge STAGE...             # the table of all stages, and its verdict

Graph, simulator, booted computers, missions and the browser depend on how the machine shares out its cores. A test that passes
alone is no reason to hold back a change, but it is a defect: it is listed as `flaky: TEST, failed 1 of 2: ERROR`, and in
build/test-stages/flaky.json, so that runs can be added up. More than MOST_FLAKY in one run fail it, as does a test that fails
three times. Tests without a clock (lint, core, the page's units) have no second try.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "build" / "test-stages"
TRIES = 3
MOST_FLAKY = 8


@dataclass(frozen=True)
class Flaky:
    """A test that failed, and passed when it was run again alone."""

    test: str
    failed: int
    runs: int
    error: str  # the first line of its first error

    def __str__(self) -> str:
        return f"flaky: {self.test}, failed {self.failed} of {self.runs}: {self.error}"


# Runs pytest with arguments; returns its exit status, and the first error line of each test that failed.
Run = Callable[[list[str]], tuple[int, dict[str, str]]]


def try_again(run: Run, failures: dict[str, str]) -> tuple[list[Flaky], list[str]]:
    """Run each failed test alone until it passes, at most TRIES times in all; return the flaky ones and the others."""
    flaky: list[Flaky] = []
    never: list[str] = []
    for test, error in failures.items():
        for failed in range(1, TRIES):
            print(f"second try: {test} alone, run {failed + 1} of {TRIES}", flush=True)
            if run([test])[0] == pytest.ExitCode.OK:
                flaky.append(Flaky(test, failed, failed + 1, error))
                break
        else:
            never.append(test)
    return flaky, never


def run_stage(run: Run, arguments: list[str]) -> tuple[int, list[Flaky]]:
    """Run a stage and the second tries of what failed in it; return its exit status and its flaky tests.

    A stage that ended otherwise than by failed tests, or with more failures than a run may have flaky tests, is not repeated.
    """
    status, failures = run(arguments)
    if status != pytest.ExitCode.TESTS_FAILED or not failures:
        return status, []
    if len(failures) > MOST_FLAKY:
        print(f"{len(failures)} tests failed; above {MOST_FLAKY} there is no second try")
        return status, []
    flaky, never = try_again(run, failures)
    for test in never:
        print(f"failed {TRIES} of {TRIES}: {test}")
    return (pytest.ExitCode.TESTS_FAILED if never else pytest.ExitCode.OK), flaky


def run_pytest(stage: str) -> Run:
    """Return a function that runs pytest in a process of its own."""

    def run(arguments: list[str]) -> tuple[int, dict[str, str]]:
        log = FOLDER / f"{stage}-failures.json"
        log.unlink(missing_ok=True)
        options = ["-p", "tests.support.failure_log", "--failure-log", str(log)]
        done = subprocess.run([sys.executable, "-m", "pytest", "-q", *options, *arguments], cwd=ROOT, check=False)
        return done.returncode, json.loads(log.read_text()) if log.exists() else {}

    return run


def run_playwright(files: list[str]) -> tuple[int, list[Flaky]]:
    """Run the page's tests in Chromium; return the exit status and the flaky tests. Without a browser, they are skipped."""
    report = ROOT / "web" / "test-results" / "report.json"
    report.unlink(missing_ok=True)
    done = subprocess.run([sys.executable, "tools/build_page.py", "e2e", *files], cwd=ROOT, check=False)
    return done.returncode, list(playwright_flaky(json.loads(report.read_text()))) if report.exists() else []


def playwright_flaky(report: dict[str, Any]) -> Iterator[Flaky]:
    """Yield the tests of Playwright's JSON report that passed only when they were repeated."""

    def specs(suite: dict[str, Any]) -> Iterator[dict[str, Any]]:
        yield from suite.get("specs", ())
        for inner in suite.get("suites", ()):
            yield from specs(inner)

    for suite in report["suites"]:
        for spec in specs(suite):
            for test in spec["tests"]:
                if test["status"] == "flaky":
                    failed = [result for result in test["results"] if result["status"] != "passed"]
                    message = failed[0].get("error", {}).get("message", failed[0]["status"])
                    yield Flaky(f"{spec['file']}: {spec['title']}", len(failed), len(test["results"]), message.splitlines()[0])


def judge(stages: dict[str, list[Flaky]]) -> int:
    """Print the flaky tests of all stages, and write them as JSON; return 1 if they are too many."""
    rows = [{"stage": stage, **asdict(flaky)} for stage, found in stages.items() for flaky in found]
    for found in stages.values():
        for flaky in found:
            print(flaky)
    path = FOLDER / "flaky.json"
    path.write_text(json.dumps(rows, indent=1) + "\n")
    print(f"flaky tests: {len(rows)} of at most {MOST_FLAKY}, in {', '.join(stages)}: {path.relative_to(ROOT)}")
    return int(len(rows) > MOST_FLAKY)


def write(stage: str, flaky: list[Flaky]) -> None:
    """Keep the flaky tests of a stage for `judge`."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    (FOLDER / f"{stage}.json").write_text(json.dumps([asdict(each) for each in flaky]))


def read(stage: str) -> list[Flaky]:
    """Return the flaky tests of a stage that ran before."""
    return [Flaky(**row) for row in json.loads((FOLDER / f"{stage}.json").read_text())]


def main(action: str, *arguments: str) -> int:
    """Run a stage, read Playwright's report, or judge all stages."""
    if action == "judge":
        unfinished = [stage for stage in arguments if not (FOLDER / f"{stage}.json").exists()]
        if unfinished:
            print(f"not run to the end: {', '.join(unfinished)}; run: make test-{unfinished[0]}", file=sys.stderr)
            return 1
        return judge({stage: read(stage) for stage in arguments})
    stage = arguments[0]
    (FOLDER / f"{stage}.json").unlink(missing_ok=True)
    if action == "playwright":
        status, flaky = run_playwright(list(arguments[1:]))
    else:
        status, flaky = run_stage(run_pytest(stage), list(arguments[1:]))
    write(stage, flaky)
    return status


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
