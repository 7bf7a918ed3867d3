"""Study of trial comparisons."""
