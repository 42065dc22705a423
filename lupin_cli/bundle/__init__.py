"""Support archives: what is collected, what is masked in it, and how the archive is written to disk."""
