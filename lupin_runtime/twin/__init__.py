"""The digital twin: the latest data of each tag, and sensor fields interpolated between tags."""
