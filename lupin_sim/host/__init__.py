"""The simulated computer of a robot: a Linux that boots in namespaces, with faults on demand (docs/simulated-computer.md)."""

from lupin_sim.host.host import Host, HostError, HostUnavailable, Robot
from lupin_sim.host.prerequisites import missing_prerequisite

__all__ = ["Host", "HostError", "HostUnavailable", "Robot", "missing_prerequisite"]
