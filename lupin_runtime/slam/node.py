"""The nodes of this room, for the stack's table."""

from __future__ import annotations

from lupin_runtime.slam.amcl_node import AmclNode
from lupin_runtime.slam.map_server import MapServer
from lupin_runtime.slam.reset_node import SlamResetNode
from lupin_runtime.slam.slam_node import SlamNode

__all__ = ["AmclNode", "MapServer", "SlamNode", "SlamResetNode"]
