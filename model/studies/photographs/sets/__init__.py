"""Readers of sets of pictures with their truth, one module for each layout."""
