"""Families of hostile files of the project: parameters, frames, datasets, networks, folders."""
