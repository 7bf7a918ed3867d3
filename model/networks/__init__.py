"""Shading and composition networks, and the methods built on them."""
