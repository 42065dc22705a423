"""A pytest plugin for errors of threads and finalizers, which surface in whatever test runs then: they are the session's.

They are printed at the end of the session, and fail it, not the test that ran.
"""

from __future__ import annotations

import warnings

import pytest

LATE = (pytest.PytestUnraisableExceptionWarning, pytest.PytestUnhandledThreadExceptionWarning)


class LateErrors:
    """Collects the errors of one session."""

    def __init__(self) -> None:
        self._texts: list[str] = []

    def pytest_warning_recorded(self, warning_message: warnings.WarningMessage) -> None:
        """Keep a warning by which pytest reports such an error."""
        if issubclass(warning_message.category, LATE):
            self._texts.append(str(warning_message.message))

    @pytest.hookimpl(tryfirst=True)
    def pytest_sessionfinish(self, session: pytest.Session, exitstatus: int) -> None:
        """Fail a session in which all tests passed; if some failed, the errors may be their consequences."""
        if self._texts and exitstatus == pytest.ExitCode.OK:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Print the errors."""
        if self._texts:
            terminalreporter.section(f"errors of threads or finalizers, of no test in particular: {len(self._texts)}")
        for text in self._texts:
            terminalreporter.line(text)


def pytest_configure(config: pytest.Config) -> None:
    """Collect in the process that sees all reports: with xdist, not in its workers."""
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(LateErrors(), LateErrors.__name__)
