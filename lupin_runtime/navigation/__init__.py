"""Navigation behind Nav2's names: layered costmaps, a global planner, an omnidirectional MPPI controller, recoveries."""
