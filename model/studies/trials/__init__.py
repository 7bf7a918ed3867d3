"""Training trials: planning, running, scoring and results, shared by the studies."""
