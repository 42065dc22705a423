"""Facts of both ends → findings."""

from lupin_cli.checks.base import Check, Evidence, Finding, Fix, Severity

__all__ = ["Check", "Evidence", "Finding", "Fix", "Severity"]
