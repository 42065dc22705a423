"""A simulated MIRTE: worlds, robot model, sensors, the vendor's ROS interface, and scoring against the ground truth."""

import os

from lupin_sim.graphics import usable_backend

# MuJoCo chooses its graphics backend at import, so the variable must be set before any module here imports it.
os.environ.setdefault("MUJOCO_GL", usable_backend())
