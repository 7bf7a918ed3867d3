"""Decomposition study: supervised shading against one stage (Figure 8 of the paper)."""
