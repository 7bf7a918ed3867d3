"""Light of imported scenes: what shines in which room, and what is added where nothing does."""
