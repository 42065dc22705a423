"""The e-stop, which combines the robot's button and the consoles into one state, and the battery and e-stop monitors.

This package exports the cores; the nodes are in `lupin_runtime.safety.node`. It is not safety-rated: the path contains no
hardware kill switch.
"""

from lupin_runtime.safety.battery_monitor import BatteryEdge, BatteryMonitor, normalize
from lupin_runtime.safety.console_stop import ConsoleStop
from lupin_runtime.safety.estop import EstopSources, EstopState
from lupin_runtime.safety.estop_monitor import EStopEdge, EStopMonitor

__all__ = [
    "BatteryEdge",
    "BatteryMonitor",
    "ConsoleStop",
    "EStopEdge",
    "EStopMonitor",
    "EstopSources",
    "EstopState",
    "normalize",
]
