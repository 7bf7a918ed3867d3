"""Training loop, loss, checkpoints and stored models."""
