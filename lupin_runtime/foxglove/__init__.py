"""Serves the graph to Foxglove and Lichtblick, read-only, through foxglove-sdk: the extra `lupin[foxglove]`."""
