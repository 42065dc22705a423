"""The robot's computer: a Linux that really boots, in namespaces of its own, with faults on demand."""

from lupin_sim.host.host import Host, HostError, HostUnavailable, Robot
from lupin_sim.host.missing import what_is_missing

__all__ = ["Host", "HostError", "HostUnavailable", "Robot", "what_is_missing"]
