"""Variants of imported scenes: the same rooms and things with other finishes and other light.

Procedural homes vary by themselves (`scenes.procedural.home`); what is drawn here comes from the
same palettes, patterns and skies.
"""
