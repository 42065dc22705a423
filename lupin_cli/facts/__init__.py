"""What a machine says of itself. One file a fact: a short POSIX-sh probe and a pure parser of its output."""

from lupin_cli.facts.base import Fact, Facts, Unknown

__all__ = ["Fact", "Facts", "Unknown"]
