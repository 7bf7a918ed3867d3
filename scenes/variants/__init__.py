"""Variants of imported scenes: the same rooms and objects with other finishes and lighting.

Finishes and skies come from the palettes, patterns and sky models of the procedural homes, which
have variants of their own (`pbrnet.scenes.procedural.home`).
"""
