"""Scene source IFC: buildings that state their storeys, spaces, doors, windows and furniture."""
