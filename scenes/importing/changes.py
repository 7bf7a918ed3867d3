"""What an import changed or lost, gathered so that the same change is said once with its count."""

from __future__ import annotations

_SHOWN = 4


class Changes:
    """Collects notes; equal sentences are merged and the details that differ are listed."""

    def __init__(self) -> None:
        self._notes: dict[str, list[str]] = {}

    def note(self, sentence: str, detail: str = "") -> None:
        """Record a change; `{}` in `sentence` stands for `detail`, which may differ each time."""
        self._notes.setdefault(sentence, []).append(detail)

    def sentences(self) -> tuple[str, ...]:
        """One sentence per kind of change, in the order of first appearance."""
        return tuple(_merge(sentence, details) for sentence, details in self._notes.items())


def _merge(sentence: str, details: list[str]) -> str:
    count = f" ({len(details)} times)" if len(details) > 1 else ""
    if "{}" not in sentence:
        return sentence + count
    distinct = list(dict.fromkeys(details))
    shown = ", ".join(distinct[:_SHOWN])
    if len(distinct) > _SHOWN:
        shown += f" and {len(distinct) - _SHOWN} more"
    return sentence.replace("{}", shown) + count
