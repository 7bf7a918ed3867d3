"""Extrapolation of learning curves: the error expected with ten times as many training views."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pbrnet.model.studies.trials.results import TrialsRow

TIMES = 10  # factor of the extrapolation, from the largest training set


def power_law(views: Sequence[float], errors: Sequence[float]) -> tuple[float, float]:
    """Fit error = scale * views ** -exponent by least squares of the logarithms.

    Returns scale and exponent. In many tasks, error follows such a law over a wide range of
    training-set sizes, up to an irreducible rest (Hestness et al. 2017). Raises `ValueError` for
    fewer than two sizes.
    """
    if len(set(views)) < 2:
        raise ValueError("a power law needs at least two sizes")
    slope, height = np.polyfit(np.log(views), np.log(errors), 1)
    return float(np.exp(height)), float(-slope)


def extrapolations(rows: Sequence[TrialsRow]) -> list[str]:
    """Return a sentence for every label that was trained with several numbers of views."""
    sentences = []
    for label in dict.fromkeys(row.label for row in rows):
        curve = sorted(
            (row.views, figure.mean)
            for row in rows
            if row.label == label and row.views and (figure := row.metrics.get("flip"))
        )
        if len({views for views, _ in curve}) < 2:
            continue
        scale, exponent = power_law(*zip(*curve, strict=True))
        most = TIMES * curve[-1][0]
        sentences.append(
            f"{label}: FLIP changes by {100 * (2**-exponent - 1):+.1f} % with every doubling of "
            f"the views; a power law through the {len(curve)} sizes gives "
            f"{scale * most**-exponent:.3f} with {most:.0f} views (no measurement)"
        )
    return sentences
