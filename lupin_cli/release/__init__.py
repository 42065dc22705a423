"""A release: everything that a deploy puts on a robot. Its files, its manifest, its signature and their verification."""
