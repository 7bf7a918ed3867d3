"""Agreement of predicted and rendered changes of brightness: direction, pattern and size.

A change is ln(luminance after / before) of a block of pixels. All measures over many views follow
from sums over their blocks, so bootstrap resampling of scenes needs no second pass over pixels.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pbrnet.model.evaluation.metrics import RESAMPLES
from pbrnet.model.studies.illumination.results import Agreement, Estimate
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.seeds import generator

BLOCK = 8  # pixels a side
LEAST_CHANGE = 0.05  # smaller rendered changes have no sign

# Columns of `sums`
_COUNT, _T, _P, _TT, _PP, _TP, _CTT, _CPP, _CTP, _CLEAR, _AGREE = range(11)


def block_means(luminance: AnyArray, side: int = BLOCK) -> AnyArray:
    """Return means over blocks of `side` x `side` pixels of (H, W), float64; a rest is ignored."""
    rows, columns = (size // side for size in luminance.shape)
    whole = luminance[: rows * side, : columns * side].astype(np.float64)
    means: AnyArray = whole.reshape(rows, side, columns, side).mean(axis=(1, 3))
    return means


def log_change(before: AnyArray, after: AnyArray) -> AnyArray:
    """Return ln(after / before) of block means; NaN where either is not positive."""
    dark = (before <= 0) | (after <= 0)
    ratio = np.where(dark, 1.0, after) / np.where(dark, 1.0, before)
    return np.where(dark, np.nan, np.log(ratio))


def sums(true: AnyArray, predicted: AnyArray) -> AnyArray:
    """Return the sums of one view that all measures need, float64 (11,), additive over views.

    Number of blocks; sums, squares and products of both changes; squares and products after
    subtraction of the view's means; number of rendered changes of at least `LEAST_CHANGE`, and how
    many of them are predicted with the correct sign. Blocks with NaN in either are ignored.
    """
    known = np.isfinite(true) & np.isfinite(predicted)
    t, p = true[known], predicted[known]
    if not len(t):
        return np.zeros(11)
    ct, cp = t - t.mean(), p - p.mean()
    clear = np.abs(t) >= LEAST_CHANGE
    return np.array(
        [
            *(len(t), t.sum(), p.sum(), t @ t, p @ p, t @ p),
            *(ct @ ct, cp @ cp, ct @ cp),
            *(clear.sum(), (clear & (np.sign(t) == np.sign(p))).sum()),
        ],
        dtype=np.float64,
    )


def agreement(views: Mapping[str, Sequence[AnyArray]], seed: int) -> Agreement | None:
    """Return all measures over `views`: scene -> `sums` of each of its views; None without blocks.

    Intervals are 95 % bootstrap intervals over scenes, because views of one scene are not
    independent; with one scene there are none.
    """
    scenes = [scene for scene in sorted(views) if sum(row[_COUNT] for row in views[scene]) > 0]
    if not scenes:
        return None
    by_scene = np.array([np.sum(views[scene], axis=0) for scene in scenes])
    drawn = generator(seed, "agreement").integers(len(scenes), size=(RESAMPLES, len(scenes)))
    total, resampled = by_scene.sum(axis=0), by_scene[drawn].sum(axis=1)
    figures = {
        name: _figure(total, resampled, measure, len(scenes)) for name, measure in _MEASURES.items()
    }
    return Agreement(
        views=sum(len(views[scene]) for scene in scenes),
        scenes=len(scenes),
        blocks=int(total[_COUNT]),
        **figures,
    )


def _correlation(s: AnyArray) -> AnyArray:
    """Pearson correlation over all blocks."""
    n = s[..., _COUNT]
    across = s[..., _TP] - s[..., _T] * s[..., _P] / n
    true = s[..., _TT] - s[..., _T] ** 2 / n
    predicted = s[..., _PP] - s[..., _P] ** 2 / n
    return _cosine(across, true, predicted, n)


def _pattern(s: AnyArray) -> AnyArray:
    """Pearson correlation after subtraction of every view's mean change."""
    return _cosine(s[..., _CTP], s[..., _CTT], s[..., _CPP], s[..., _COUNT])


def _cosine(across: AnyArray, true: AnyArray, predicted: AnyArray, count: AnyArray) -> AnyArray:
    # A uniform change has no pattern; the remainder is rounding.
    uniform = np.minimum(true, predicted) <= 1e-9 * count
    return np.where(uniform, np.nan, across / np.sqrt(np.where(uniform, 1.0, true * predicted)))


def _sign(s: AnyArray) -> AnyArray:
    """Share of rendered changes above `LEAST_CHANGE` whose sign is predicted."""
    return _divided(s[..., _AGREE], s[..., _CLEAR])


def _gain(s: AnyArray) -> AnyArray:
    """Predicted per rendered change: the slope of a regression line through 0."""
    return _divided(s[..., _TP], s[..., _TT])


def _true(s: AnyArray) -> AnyArray:
    return _divided(s[..., _T], s[..., _COUNT])


def _predicted(s: AnyArray) -> AnyArray:
    return _divided(s[..., _P], s[..., _COUNT])


def _divided(above: AnyArray, below: AnyArray) -> AnyArray:
    return np.where(below > 0, above / np.where(below > 0, below, 1.0), np.nan)


_MEASURES = {
    "correlation": _correlation,
    "pattern": _pattern,
    "sign": _sign,
    "gain": _gain,
    "true": _true,
    "predicted": _predicted,
}


def _figure(total: AnyArray, resampled: AnyArray, measure: object, scenes: int) -> Estimate | None:
    assert callable(measure)
    value = float(measure(total))
    if not np.isfinite(value):
        return None
    draws = measure(resampled)
    draws = draws[np.isfinite(draws)]
    if scenes < 2 or not len(draws):
        return Estimate(value, None, None)
    low, high = np.quantile(draws, [0.025, 0.975])
    return Estimate(value, float(low), float(high))
