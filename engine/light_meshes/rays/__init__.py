"""Rays and triangles: camera rays, the triangles in the tracer's frame, and Embree, which only `tracer` uses."""
