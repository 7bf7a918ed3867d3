"""Baselines: the networks that PBR-Net is compared with, one module for each paper."""
