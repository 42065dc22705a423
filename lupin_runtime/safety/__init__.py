"""The safety lane: the e-stop of buttons and consoles folded into one state, and the edges that the mission acts on.

Cores only; the node is in `lupin_runtime.safety.node`. Not safety rated: there is no hardware kill switch in this path.
"""

from lupin_runtime.safety.battery_monitor import BatteryEdge, BatteryMonitor, normalise
from lupin_runtime.safety.consoles import ConsoleLane
from lupin_runtime.safety.estop import EstopSources, EstopState
from lupin_runtime.safety.estop_monitor import EStopEdge, EStopMonitor

__all__ = [
    "BatteryEdge",
    "BatteryMonitor",
    "ConsoleLane",
    "EStopEdge",
    "EStopMonitor",
    "EstopSources",
    "EstopState",
    "normalise",
]
