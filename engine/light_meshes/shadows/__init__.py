"""How much of each light a receiver sees: one contract, and a file for each method."""
