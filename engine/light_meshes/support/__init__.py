"""What every room uses: compiled kernels, sets of bits, counts and times."""
