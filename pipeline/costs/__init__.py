"""Cost ledger of rendered frames and forecasts of a run."""
