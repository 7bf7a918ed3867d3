"""Procedural homes: floor plans, furniture, materials and light from a seed."""
