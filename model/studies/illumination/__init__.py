"""Study of changed illumination."""
