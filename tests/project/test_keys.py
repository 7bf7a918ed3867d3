"""Keys: each stage names those of what it makes, and no code behind one changes unnoticed."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from pbrnet.model.methods import METHODS
from pbrnet.pipeline.channels import KINDS
from pbrnet.pipeline.keys import table
from pbrnet.pipeline.passes.registry import TRACE_OF
from pbrnet.pipeline.render.scene import set_variant
from tests.fixtures.outputs import OUTPUTS, differing, output
from tests.fixtures.paths import ROOT
from tests.project import record_keys

STAGES: dict[str, dict[str, Any]] = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"]


def keys_of(stage: str) -> set[str]:
    """The keys that a stage has as parameters; of `train_baselines` those of all networks."""
    named = next(each["keys.yaml"] for each in STAGES[stage]["params"] if isinstance(each, dict))
    prefixes = [name.replace("${item.name}", "") for name in named]
    return {
        name
        for name in table()
        if any(name == one or name.startswith(one.rstrip(".") + ".") for one in prefixes)
    }


def test_every_key_is_one_of_a_stage_or_of_exports_or_of_a_study() -> None:
    others = {name for name in table() if name == "exports" or name.startswith("studies.")}
    assert set().union(*map(keys_of, STAGES)) == set(table()) - others
    assert set(record_keys.entries()) == set(table())


def test_no_stage_names_code() -> None:
    assert not [dep for one in STAGES.values() for dep in one.get("deps", ()) if ".py" in dep]


@pytest.mark.parametrize("kind", KINDS)
def test_the_stage_of_a_frame_has_its_keys(kind: str) -> None:
    (stage,) = (
        name for name, one in STAGES.items() if any(f"data/{kind}" in out for out in one["outs"])
    )
    assert {"render", *TRACE_OF[kind].keys[kind]} <= keys_of(stage)


def test_networks_of_one_form_have_one_number() -> None:
    for name, method in METHODS.items():
        assert table()[f"networks.{method.kind}"] == table()[f"networks.{name}"], name


def test_changed_code_was_decided_on() -> None:
    """If this fails: raise the key in keys.yaml if other things are made; then record it."""
    known = record_keys.known()
    now = {name: {"key": table()[name], "code": code} for name, code in record_keys.codes().items()}
    other = [name for name, row in now.items() if {**known.get(name, {}), **row} != known.get(name)]
    assert not other, f"{', '.join(other)}: see python -m tests.project.record_keys --help"


def test_one_command_records_what_was_decided() -> None:
    changed = {"evaluate", "report"}
    (line,) = record_keys.faults(changed, set(), {"evaluate"})
    assert line.endswith("--same evaluate report")
    assert record_keys.faults(changed, set(), changed) == []


@pytest.mark.parametrize("name", OUTPUTS)
def test_what_is_made_is_what_was_recorded_under_its_key(name: str) -> None:
    """If this fails: raise the key in keys.yaml, or undo what changed its output."""
    set_variant("auto")
    assert differing(record_keys.known()[name]["output"], output(name)) == []


def test_a_part_of_an_output_that_differs_is_named() -> None:
    known: Any = {"a": "1", "b": [1.0, 2.0], "c": "3"}
    assert differing(known, {"a": "1", "b": [1.0005, 2.0], "d": "3"}) == ["c", "d"]
    assert differing(known, {**known, "b": [1.1, 2.0]}) == ["b"]
    assert record_keys.of(differing("1", "2")) == "" and record_keys.of(["c"]) == " (c)"


def test_comments_and_docstrings_are_no_change(tmp_path: Path) -> None:
    texts = {
        "a": 'def f(x: int) -> int:\n    """Return x."""\n    return x  # here\n',
        "b": 'def f(x):\n    """Return what came in."""\n\n    return x\n',
        "c": "def f(x):\n    return x + 1\n",
    }
    found = {}
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
        found[name] = record_keys._normalised(tmp_path / name)
    assert found["a"] == found["b"] != found["c"]
