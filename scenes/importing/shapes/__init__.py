"""Shapes that an import adds, takes apart or moves: panes, doubled faces, seals."""
