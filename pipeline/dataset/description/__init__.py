"""Descriptions of the packed dataset: card, Croissant file, citation."""
