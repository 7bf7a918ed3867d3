"""Hostile and damaged inputs of every kind, made from fixed seeds and run through the command line.

`python -m tests.hostile` runs all of them and prints a table of outcomes by family.
"""
