"""Draws: every method is one call of NumPy's generator, so recorded scenes stay the same."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pbrnet.scenes.seeds import Draw, generator

ITEMS = ("oak", "ash", "beech", "elm", "pine")
SHARES = (0.1, 0.4, 0.2, 0.2, 0.1)


@pytest.mark.parametrize(
    ("named", "plain"),
    [
        (lambda draw: draw.between(-2, 3), lambda rng: rng.uniform(-2, 3)),
        (lambda draw: draw.whole(7), lambda rng: rng.integers(7)),
        (lambda draw: draw.whole(3, 7), lambda rng: rng.integers(3, 7)),
        (lambda draw: draw.variant(), lambda rng: rng.integers(1 << 30)),
        (lambda draw: draw.chance(0.3), lambda rng: rng.random() < 0.3),
        (lambda draw: draw.pick(ITEMS), lambda rng: ITEMS[rng.integers(5)]),
        (lambda draw: draw.pick(ITEMS), lambda rng: rng.choice(ITEMS)),
        (lambda draw: draw.weighted(ITEMS, SHARES), lambda rng: rng.choice(ITEMS, p=SHARES)),
        (lambda draw: draw.shuffled(ITEMS), lambda rng: [ITEMS[k] for k in rng.permutation(5)]),
    ],
)
def test_a_draw_is_one_call_of_the_generator(
    named: Callable[[Draw], Any], plain: Callable[[np.random.Generator], Any]
) -> None:
    draw, rng = Draw(np.random.PCG64(4)), np.random.default_rng(4)
    for _ in range(50):
        assert named(draw) == plain(rng)
        assert draw.random() == rng.random()


def test_generators_of_seeds_and_names_are_draws() -> None:
    draw = generator(3, "sofa")
    assert isinstance(draw, Draw)
    assert draw.pick(ITEMS) == generator(3, "sofa").pick(ITEMS)
    assert {type(draw.between(0, 1)), type(draw.whole(3))} == {float, int}
