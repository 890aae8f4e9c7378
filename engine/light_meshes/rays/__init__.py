"""Rays and triangles: the camera's rays, the triangles in the tracer's frame, and Embree, which only `tracer` knows."""
