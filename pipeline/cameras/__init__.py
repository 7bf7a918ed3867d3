"""Cameras beyond sampled views: walks, trajectories from files, overlap, reprojection."""
