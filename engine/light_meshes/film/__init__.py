"""Pixels and files: the passes that a picture can have, the samples of their tiles, and writing pictures."""
