"""Model predictive path integral control of the omnidirectional base: sampling, critics, smoothing."""

from lupin_runtime.navigation.mppi.controller import Command, LocalPath, MppiController, NoValidControl
from lupin_runtime.navigation.mppi.parameters import MppiParameters

__all__ = ["Command", "LocalPath", "MppiController", "MppiParameters", "NoValidControl"]
