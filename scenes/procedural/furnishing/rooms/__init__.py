"""What goes into a room of each kind, and where: a module a kind, others for shared groups."""
