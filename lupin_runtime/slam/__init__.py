"""Mapping and localisation: scan matching, a pose graph with loop closure, occupancy grids, and AMCL's place on a saved map."""
