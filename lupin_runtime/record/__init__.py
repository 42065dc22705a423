"""The flight recorder: serialised messages into MCAP files, out of them again, and back onto a graph."""
