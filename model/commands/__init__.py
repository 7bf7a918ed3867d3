"""Commands that train, evaluate and use networks."""
