"""The thin shell between cores and rclpy: a node that reads `graph.py`, transforms, and the host that runs nodes.

Works with Jazzy's rclpy from wheels and with Humble's on Python 3.10, which is what the robot has.
"""

from lupin_runtime.ros.host import run
from lupin_runtime.ros.node import LupinNode
from lupin_runtime.ros.stamps import stamp_from_ns, stamp_ns
from lupin_runtime.ros.tf import TransformBroadcaster, TransformListener

__all__ = ["LupinNode", "TransformBroadcaster", "TransformListener", "run", "stamp_from_ns", "stamp_ns"]
