"""A picture, tile by tile: a scene made ready, what it needs and why, the wave of rays, what is kept for the next."""
