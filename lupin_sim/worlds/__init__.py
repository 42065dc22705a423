"""Greenhouses by name: `demo`, `course`, `random:SEED`, `walled`, or the path of a layout file."""

from lupin_sim.worlds.catalogue import CATALOGUE, WorldError, load_world

__all__ = ["CATALOGUE", "WorldError", "load_world"]
