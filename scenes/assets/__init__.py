"""Converted furniture catalogues: pieces, index, support surfaces and previews."""
