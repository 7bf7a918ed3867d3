"""Floor plans that are held out for testing, by name or pattern."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase


def kept_back(test_only: Sequence[str], plans: Mapping[str, str]) -> set[str]:
    """Return the plans that the names and patterns of `test_only` match.

    `plans` maps scene ids to plans; a match of a scene holds out its whole plan.
    """
    return {
        plan
        for scene, plan in plans.items()
        if any(fnmatchcase(name, pattern) for name in (scene, plan) for pattern in test_only)
    }
