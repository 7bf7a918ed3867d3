"""Agreement of changes, for synthetic changes with known results."""

import numpy as np
import pytest

from pbrnet.model.studies.illumination.agreement import (
    LEAST_CHANGE,
    agreement,
    block_means,
    log_change,
    sums,
)
from pbrnet.model.studies.illumination.results import Agreement, Estimate


def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def measured(pairs: dict[str, list[tuple[np.ndarray, np.ndarray]]]) -> Agreement:
    found = agreement({scene: [sums(*pair) for pair in list_] for scene, list_ in pairs.items()}, 0)
    assert found is not None
    return found


def value(figure: Estimate | None) -> float:
    assert figure is not None
    return figure.value


@pytest.mark.parametrize("gain", [0.5, 1.0, 3.0, -2.0])
def test_a_multiple_of_the_truth(gain: float) -> None:
    true = {scene: [rng().normal(0.2, 1, (15, 20)) for _ in range(2)] for scene in "ab"}
    found = measured({scene: [(t, gain * t) for t in views] for scene, views in true.items()})
    side = 1.0 if gain > 0 else -1.0
    assert value(found.correlation) == pytest.approx(side)
    assert value(found.pattern) == pytest.approx(side)
    assert value(found.gain) == pytest.approx(gain)
    assert value(found.sign) == (1.0 if gain > 0 else 0.0)
    assert (found.views, found.scenes, found.blocks) == (4, 2, 4 * 300)


def test_correlation_is_that_of_all_blocks_together() -> None:
    random = rng()
    views = [(random.normal(k, 1, (6, 8)), random.normal(-k, 2, (6, 8))) for k in range(5)]
    found = measured({f"s{k}": [pair] for k, pair in enumerate(views)})
    true = np.concatenate([t.ravel() for t, _ in views])
    predicted = np.concatenate([p.ravel() for _, p in views])
    assert value(found.correlation) == pytest.approx(np.corrcoef(true, predicted)[0, 1])
    true = np.concatenate([(t - t.mean()).ravel() for t, _ in views])
    predicted = np.concatenate([(p - p.mean()).ravel() for _, p in views])
    assert value(found.pattern) == pytest.approx(np.corrcoef(true, predicted)[0, 1])
    assert value(found.predicted) == pytest.approx(np.mean([p.mean() for _, p in views]))


def test_a_wrong_level_leaves_the_pattern() -> None:
    random = rng()
    views = [random.normal(0, 0.3, (6, 8)) for _ in range(4)]
    pairs = {f"s{k}": [(t, t + 5 * (-1) ** k)] for k, t in enumerate(views)}
    found = measured(pairs)
    assert value(found.pattern) == pytest.approx(1)
    assert value(found.correlation) < 0.2


def test_an_even_change_has_a_size_but_no_pattern() -> None:
    even = np.full((6, 8), np.log(2))
    found = measured({"a": [(even, even / 2)], "b": [(even, even / 2)]})
    assert found.pattern is None and found.correlation is None
    assert found.gain == Estimate(pytest.approx(0.5), pytest.approx(0.5), pytest.approx(0.5))
    assert value(found.sign) == 1


def test_what_is_too_small_has_no_sign_and_what_is_dark_does_not_count() -> None:
    true = np.array([[0.9 * LEAST_CHANGE, -0.9 * LEAST_CHANGE, 1.0, -1.0, np.nan, 1.0]])
    predicted = np.array([[-1.0, 1.0, 1.0, 1.0, 1.0, np.nan]])
    found = measured({"a": [(true, predicted)]})
    assert found.blocks == 4 and value(found.sign) == 0.5


def test_intervals_are_over_scenes() -> None:
    random = rng()
    one = (random.normal(0, 1, (6, 8)), random.normal(0, 1, (6, 8)))
    found = measured({"a": [one, one]})
    assert found.correlation is not None and found.correlation.low is None
    same = measured({"a": [one], "b": [one], "c": [one]}).correlation
    assert same is not None and same.low == pytest.approx(same.value) == pytest.approx(same.high)
    good, bad = (one[0], one[0]), (one[0], -one[0])
    mixed = measured({"a": [good], "b": [good], "c": [good], "d": [bad]}).sign
    assert mixed is not None and (mixed.low, mixed.high) == (0.25, 1.0) and mixed.value == 0.75


def test_no_blocks_no_figures() -> None:
    nothing = np.full((2, 2), np.nan)
    assert agreement({"a": [sums(nothing, nothing)]}, 0) is None


def test_blocks_and_their_changes() -> None:
    image = np.arange(19 * 17, dtype=np.float32).reshape(19, 17)
    means = block_means(image)
    assert means.shape == (2, 2)
    assert means[1, 0] == image[8:16, :8].mean()
    change = log_change(np.array([1.0, 0.0, 2.0]), np.array([2.0, 1.0, 0.0]))
    assert change[0] == pytest.approx(np.log(2)) and np.isnan(change[1:]).all()
