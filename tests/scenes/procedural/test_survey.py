"""Survey of many homes: it keeps outcomes, continues, and reports faults."""

import json
from pathlib import Path

import pytest

from tests.scenes.procedural import survey, test_homes


def test_a_survey_continues_and_names_faults(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def hollow(homes: list[test_homes.Home]) -> None:
        if homes[0].seed == 18:
            pytest.fail("a made fault")

    monkeypatch.setattr(survey, "RULES", (hollow,))
    out = tmp_path / "homes.jsonl"
    (first,) = survey.survey([18], out, 1)
    assert first["faults"] == ["hollow: Failed: a made fault"]
    assert "seed 18: hollow" in capsys.readouterr().out
    out.write_text(out.read_text() + '\n{"seed": 19, "fau')  # stopped while writing
    monkeypatch.setattr(test_homes, "home_of", lambda *args: pytest.fail("made again"))
    assert survey.survey([18], out, 1) == [first]
    monkeypatch.undo()
    monkeypatch.setattr(survey, "RULES", (hollow,))
    both = survey.survey([18, 19], out, 1)
    assert [bool(one["faults"]) for one in both] == [True, False]
    assert json.loads(out.read_text().splitlines()[-1])["seed"] == 19
    assert "2 homes, 1 with faults" in survey.summary(both)


@pytest.mark.check
@pytest.mark.timeout(20_000)
def test_a_thousand_homes_are_sound(tmp_path: Path) -> None:
    """All homes are made and differ; nothing intersects or floats; all rooms can be walked."""
    found = survey.survey(range(1000, 2000), tmp_path / "homes.jsonl", 2)
    assert [one for one in found if one["faults"]] == []
    assert len({(one["triangles"], one["objects"], one["style"]) for one in found}) > 990
