"""Readers of layout formats."""
