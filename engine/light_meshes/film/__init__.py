"""Pixels and files: the passes that a picture may have, their tiles, and where they go."""
