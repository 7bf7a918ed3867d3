"""Paired comparison by observers (Table II of the paper)."""
