"""Noise study: networks trained on noisy ground truth (Figure 11 of the paper)."""
