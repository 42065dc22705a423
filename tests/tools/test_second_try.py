"""A test that passes alone is flaky and counted; one that fails three times, or too many, fail the run."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tools import second_try
from tools.second_try import MOST_FLAKY, Flaky, Run, judge, playwright_flaky, run_stage

EXIT = pytest.ExitCode
OK, FAILED = EXIT.OK, EXIT.TESTS_FAILED


def scripted(stage: dict[str, str], failures_alone: dict[str, int]) -> Run:
    """Return a stand-in for pytest: what fails in the stage, and how often each test then fails alone."""
    left = dict(failures_alone)

    def run(arguments: list[str]) -> tuple[int, dict[str, str]]:
        if arguments == ["stage"]:
            return (FAILED if stage else OK), stage
        (test,) = arguments
        left[test] -= 1
        return (FAILED, {test: "again"}) if left[test] >= 0 else (OK, {})

    return run


def test_stage_without_failures_has_no_second_try() -> None:
    assert run_stage(scripted({}, {}), ["stage"]) == (OK, [])


def test_failures_that_pass_alone_are_counted() -> None:
    run = scripted({"a": "late", "b": "lost"}, {"a": 0, "b": 1})
    assert run_stage(run, ["stage"]) == (OK, [Flaky("a", 1, 2, "late"), Flaky("b", 2, 3, "lost")])


def test_three_failures_fail_the_stage() -> None:
    assert run_stage(scripted({"a": "late", "b": "wrong"}, {"a": 0, "b": 2}), ["stage"]) == (FAILED, [Flaky("a", 1, 2, "late")])


def test_more_failures_than_may_be_flaky_are_not_repeated() -> None:
    failures = {str(number): "broken" for number in range(MOST_FLAKY + 1)}
    assert run_stage(scripted(failures, {}), ["stage"]) == (FAILED, [])


@pytest.mark.parametrize(
    "status", [pytest.ExitCode.INTERRUPTED, pytest.ExitCode.USAGE_ERROR, pytest.ExitCode.NO_TESTS_COLLECTED, -11]
)
def test_stage_that_ended_otherwise_is_not_repeated(status: int) -> None:
    assert run_stage(lambda _: (status, {"a": "late"}), ["stage"]) == (status, [])


@pytest.mark.parametrize(("count", "status"), [(0, 0), (MOST_FLAKY, 0), (MOST_FLAKY + 1, 1)])
def test_table_lists_all_and_limits_their_number(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], count: int, status: int
) -> None:
    monkeypatch.setattr(second_try, "ROOT", tmp_path)
    monkeypatch.setattr(second_try, "FOLDER", tmp_path / "stages")
    second_try.write("graph", [Flaky(f"test_{number}", 1, 2, "no message") for number in range(count)])
    second_try.write("host", [])
    assert judge({stage: second_try.read(stage) for stage in ("graph", "host")}) == status
    lines = capsys.readouterr().out.splitlines()
    assert lines[:-1] == [f"flaky: test_{number}, failed 1 of 2: no message" for number in range(count)]
    assert lines[-1].startswith(f"flaky tests: {count} of at most {MOST_FLAKY}, in graph, host: ")
    assert [row["stage"] for row in json.loads((tmp_path / "stages" / "flaky.json").read_text())] == ["graph"] * count


def test_browser_tests_that_passed_again_are_counted() -> None:
    failed, passed = {"status": "failed", "error": {"message": "Error: no stop\n at line 3"}}, {"status": "passed"}
    tests = [
        {"status": "expected", "results": [passed]},
        {"status": "flaky", "results": [failed, passed]},
        {"status": "flaky", "results": [{"status": "timedOut"}, failed, passed]},
        {"status": "unexpected", "results": [failed, failed, failed]},
    ]
    specs = [{"title": f"t{number}", "file": "stop.spec.ts", "tests": [test]} for number, test in enumerate(tests)]
    report = {"suites": [{"specs": specs[:2], "suites": [{"specs": specs[2:]}]}]}
    assert list(playwright_flaky(report)) == [
        Flaky("stop.spec.ts: t1", 1, 2, "Error: no stop"),
        Flaky("stop.spec.ts: t2", 2, 3, "timedOut"),
    ]


@pytest.mark.parametrize("workers", [[], ["-n", "2"]], ids=["one process", "xdist"])
def test_failures_are_written_with_their_first_line(tmp_path: Path, workers: list[str]) -> None:
    (tmp_path / "test_it.py").write_text(
        "import pytest\n"
        "@pytest.fixture\ndef broken():\n    raise OSError('no device')\n"
        "@pytest.mark.parametrize('name', ['a b', 'c[d]'])\n"
        "def test_fails(name):\n    assert name == 'x', 'it is\\nnot x'\n"
        "def test_passes(): pass\n"
        "def test_errors(broken): pass\n"
    )
    log = tmp_path / "log.json"
    command = [sys.executable, "-m", "pytest", "-q", "-p", "tests.support.failure_log", "--failure-log", str(log), *workers]
    done = subprocess.run([*command, "--rootdir", str(tmp_path), str(tmp_path / "test_it.py")], check=False, timeout=100)
    assert done.returncode == FAILED
    assert json.loads(log.read_text()) == {
        "test_it.py::test_fails[a b]": "AssertionError: it is",
        "test_it.py::test_fails[c[d]]": "AssertionError: it is",
        "test_it.py::test_errors": "OSError: no device",
    }
