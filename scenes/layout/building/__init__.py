"""Plan of a layout: faces of walls around its rooms, and openings in them."""
