"""Descriptions and drawings of scenes, frames, shards and models."""
