"""The scene: its description as dataclasses, and reading and writing it as a folder (a snapshot), which is not
trusted.
"""
