"""Leaves the graph, within a bound."""

from __future__ import annotations

import ctypes
import threading

import rclpy
from rclpy.node import Node

from lupin_runtime.ending import STUCK

LEAVE_TIMEOUT_S = 3.0


def leave_graph(node: Node) -> None:
    """Destroy the only node of this process, which has no rosout, so that others are informed at once; shut rclpy down.

    If the middleware does not return within LEAVE_TIMEOUT_S, STUCK is set. Others then see the node until its lease expires.
    """
    handle = node.handle
    handle.__enter__()  # keeps rclpy from deleting the node itself, which it does with Python's global lock held
    node.destroy_node()
    # A function of a CDLL runs without that lock. Deleting again does nothing, so that rclpy may do it afterwards.
    arguments = (ctypes.c_void_p(handle.pointer),)
    deletion = threading.Thread(target=ctypes.CDLL("librcl.so").rcl_node_fini, args=arguments, daemon=True)
    deletion.start()
    deletion.join(LEAVE_TIMEOUT_S)
    if deletion.is_alive():
        STUCK.set()
        return
    handle.__exit__(None, None, None)
    rclpy.try_shutdown()
