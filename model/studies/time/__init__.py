"""Study of computation time."""
