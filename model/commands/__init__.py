"""Commands that train, evaluate, export and run networks, and the report."""
