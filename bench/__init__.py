"""Measurements against a peer or a limit in the same run. Quote ratios: machines are noisy, and no test asserts a time."""
