"""Benchmarks: each measures Lupin and a peer or a limit in the same run. Quote the ratios, since machines are noisy."""
