"""Recording: writes serialized messages to MCAP files, reads them, and plays them back onto a graph."""
