"""Layouts: rooms, openings and boxes of furniture, from which a whole furnished home is made.

`layout.py` is the contract that every reader of a format fills; `importer.py` builds, furnishes and
lights it with the generator of procedural homes.
"""
