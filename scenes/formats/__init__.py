"""Readers of model files: OBJ, 3DS, COLLADA and the archives that hold them."""
