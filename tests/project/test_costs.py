"""The sample of costly tests: random by a seed, within its budget, of tests that exist."""

import json

from tests.costs import ALWAYS, COSTLY, FILE, SAMPLE, sample
from tests.fixtures.paths import ROOT


def test_the_sample_keeps_its_budget_and_differs_by_seed() -> None:
    costs: dict[str, float] = json.loads(FILE.read_text())
    samples = [list(sample(costs, str(seed))) for seed in range(20)]
    assert samples == [list(sample(costs, str(seed))) for seed in range(20)]
    assert len({tuple(each) for each in samples}) == 20
    for each in samples:
        assert SAMPLE / 2 < sum(costs[name] for name in each) <= SAMPLE
    assert len(set().union(*samples)) > 0.7 * len(costs), "each test has its turn"


def test_costly_tests_are_there() -> None:
    costs: dict[str, float] = json.loads(FILE.read_text())
    for name, seconds in costs.items():
        file, test = name.split("::", 1)
        function = test.split("::")[-1].split("[")[0]
        assert f"def {function}(" in (ROOT / file).read_text(), (
            f"{name}: remove it from {FILE.name}"
        )
        assert seconds >= COSTLY and not file.startswith(ALWAYS)
