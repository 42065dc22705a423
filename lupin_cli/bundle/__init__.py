"""Support archives: what goes in, what is masked in it, and how it gets onto the disk whole or not at all."""
