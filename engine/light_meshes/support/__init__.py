"""What every room uses: the call of kernels, sets of bits, counts and times."""
