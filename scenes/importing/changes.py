"""List of everything that an import changed or left out, for `scene.json` and the command."""

from __future__ import annotations

# Start notes of a scene without rooms, and of one that may lie on its side. The command warns then,
# and ends with exit code 1.
NO_ROOM = "NO ROOM WAS FOUND"
UNSURE_UP = "THE UP AXIS IS NOT SURE"
UNSURE_SCALE = "THE UNIT OF LENGTH IS NOT SURE"
DOUBTS = (NO_ROOM, UNSURE_UP, UNSURE_SCALE)
_SHOWN = 4  # details of one sentence that are listed


class Changes:
    """Collects notes and merges equal sentences into one, with a count and their details."""

    def __init__(self) -> None:
        self._notes: dict[str, list[str]] = {}

    def note(self, sentence: str, detail: str = "") -> None:
        """Record a change; `{}` in `sentence` is replaced by the details of all its notes."""
        self._notes.setdefault(sentence, []).append(detail)

    def sentences(self) -> tuple[str, ...]:
        """One sentence for each kind of change, in the order of first appearance."""
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
