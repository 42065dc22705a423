"""A release: what travels to a robot, how it gets there whole or not at all, and which one is current."""
