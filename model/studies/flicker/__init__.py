"""Temporal stability of predictions along a camera move."""
