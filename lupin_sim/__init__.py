"""A MIRTE that isn't there: worlds, the robot's body, its sensors, the vendor's side of the graph, scoring against truth."""

import os

from lupin_sim.graphics import usable_backend

# MuJoCo decides about graphics while it is imported, so the choice has to stand before any module here imports it.
os.environ.setdefault("MUJOCO_GL", usable_backend())
