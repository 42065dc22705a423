"""Greenhouses by name: `demo`, `course`, `random:SEED`, `walled`, or the path of a layout file."""

from lupin_sim.worlds.catalog import CATALOG, WorldError, load_world

__all__ = ["CATALOG", "WorldError", "load_world"]
