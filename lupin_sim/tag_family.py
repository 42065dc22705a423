"""AprilTag family 36h11, in numbers."""

FAMILY_SIZE = 587
# What the packaged greenhouse gives readings for: 1 to 30 without 8.
KNOWN_IDS = tuple(i for i in range(1, 31) if i != 8)
