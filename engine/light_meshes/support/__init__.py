"""Tools that every room uses: calls of kernels, bit sets, counts and times."""
