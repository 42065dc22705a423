"""A release: everything that a deploy puts on a robot. Its files, its transfer, and the choice of the current one."""
