"""Study of noise in the training data."""
