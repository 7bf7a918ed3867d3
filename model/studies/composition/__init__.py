"""Composition study: a network against multiplication (Figure 9 of the paper)."""
