"""Furnishing rules: one module per room type, and modules for furniture groups they share."""
