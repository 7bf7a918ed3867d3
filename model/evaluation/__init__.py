"""Inference, image metrics and evaluation of trained methods."""
