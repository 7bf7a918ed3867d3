"""Illumination study: predicted against rendered changes of light (Figure 10 of the paper)."""
