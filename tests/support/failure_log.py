"""A pytest plugin that writes which tests failed, each with the first line of its error: -p tests.support.failure_log."""

from __future__ import annotations

import json
from pathlib import Path

import pytest


class FailureLog:
    """Collects failures of setup, test and teardown, and writes them when the session ends."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._errors: dict[str, str] = {}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Keep the first failure of each test."""
        if report.failed:
            self._errors.setdefault(report.nodeid, first_error_line(report))

    def pytest_sessionfinish(self) -> None:
        """Write a JSON object: the test's node id, and the first line of its error."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        self._path.write_text(json.dumps(self._errors))


def first_error_line(report: pytest.TestReport) -> str:
    """Return the first line of the error; without a traceback, as for a skip that counts as failed, the last of the text."""
    crash = getattr(report.longrepr, "reprcrash", None)
    lines = crash.message.splitlines() if crash is not None else report.longreprtext.splitlines()[-1:]
    return next((line.strip() for line in lines if line.strip()), report.outcome)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add --failure-log."""
    parser.addoption("--failure-log", type=Path, help="write the tests that failed to this file, as JSON")


def pytest_configure(config: pytest.Config) -> None:
    """Collect in the process that sees all reports: with xdist, not in its workers."""
    path: Path | None = config.getoption("--failure-log")
    if path is not None and not hasattr(config, "workerinput"):
        config.pluginmanager.register(FailureLog(path))
