"""Hypothesis without deadlines: on a shared machine single examples may be slow."""

from hypothesis import settings

settings.register_profile("shared machine", deadline=None)
settings.load_profile("shared machine")
