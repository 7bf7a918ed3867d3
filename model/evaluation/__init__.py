"""Metrics, inference and evaluation of methods."""
