"""Figures with their intervals, as tables show them."""

from __future__ import annotations


def interval(low: float | None, high: float | None, digits: int, sign: str = "") -> str:
    """Format an interval; empty if it is unknown. `sign` "+" shows the sign of positive numbers."""
    if low is None or high is None:
        return ""
    return f"{low:{sign}.{digits}f} to {high:{sign}.{digits}f}"


def with_interval(
    value: float, low: float | None, high: float | None, digits: int, sign: str = ""
) -> str:
    """Format a figure with its interval in brackets, if that is known."""
    around = interval(low, high, digits, sign)
    return f"{value:{sign}.{digits}f}" + (f" ({around})" if around else "")
