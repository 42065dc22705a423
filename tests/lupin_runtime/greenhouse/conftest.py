"""Property tests on a shared machine: one slow example is not a failure."""

from hypothesis import settings

settings.register_profile("shared machine", deadline=None)
settings.load_profile("shared machine")
