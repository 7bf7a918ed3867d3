"""Study of flicker between neighbouring views."""
