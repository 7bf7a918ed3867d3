"""Things that people leave in rooms: their kinds, and the generators of them."""
