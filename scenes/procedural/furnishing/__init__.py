"""Furniture placement of procedural homes, room by room."""
