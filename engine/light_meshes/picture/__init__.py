"""A picture, tile by tile: preparing a scene, deciding what it needs and why, tracing rays, and keeping data for the
next picture.
"""
