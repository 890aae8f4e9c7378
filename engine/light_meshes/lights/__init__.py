"""Types of light, a pair of files each: what Python must know of it, and how much of it arrives."""
