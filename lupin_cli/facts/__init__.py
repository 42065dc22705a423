"""Facts about a machine, one per file: a short POSIX sh probe and a pure parser of its output."""

from lupin_cli.facts.base import Fact, Facts, Unknown

__all__ = ["Fact", "Facts", "Unknown"]
