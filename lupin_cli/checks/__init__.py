"""Pure checks: facts of both machines → findings."""

from lupin_cli.checks.base import Check, Finding, Fix, Gap, Severity, Snapshot

Evidence = Snapshot  # the name under which plug-ins of earlier versions import it

__all__ = ["Check", "Evidence", "Finding", "Fix", "Gap", "Severity", "Snapshot"]
