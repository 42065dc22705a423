"""Mapping and localization: scan matching, a pose graph with loop closure, occupancy grids, and AMCL on a saved map."""
