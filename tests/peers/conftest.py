"""The fixtures for tests that run in bpy or in Blender."""

from blender_fixtures import *  # noqa: F403 (fixtures are found by their names)
from node_pictures import plane  # noqa: F401
