"""Study of paired comparisons by human observers."""
