"""Generalisation study: scenes of another source (Figures 14 and 15 of the paper)."""
