"""Cameras beyond single views: walks, trajectories from files, stereo partners, overlapping sets."""
