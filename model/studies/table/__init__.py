"""Method table: all methods trained alike (Table I of the paper)."""
