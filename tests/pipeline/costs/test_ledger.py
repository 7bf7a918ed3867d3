"""The ledger of costs: one row a thing, whatever is made again or interrupted."""

from pathlib import Path

import pytest

from pbrnet.pipeline.costs.ledger import SCHEMA, Ledger, ledger_path, read_ledger
from pbrnet.pipeline.inspection.describe import inspect_path
from pbrnet.scenes.errors import InputError


def test_a_row_is_replaced_and_counts_how_often_it_was_made(tmp_path: Path) -> None:
    assert read_ledger(tmp_path).num_rows == 0
    ledger = Ledger(tmp_path)
    ledger.add(("color", "b", "001"), seconds=2.0, spp=16)
    ledger.add(("color", "a", "001"), seconds=1.0)
    ledger.add(("color", "a", "001"), seconds=3.0)
    ledger.save()
    later = Ledger(tmp_path)
    later.add(("color", "b", "001"), seconds=5.0)
    later.add(("scenes", "b", ""), seconds=7.0)
    later.save()
    later.add(("color", "b", "001"), seconds=6.0)
    later.save()
    rows = [
        tuple(row[name] for name in ("stage", "scene_id", "view_id", "seconds", "spp", "times"))
        for row in read_ledger(tmp_path).to_pylist()
    ]
    assert rows == [
        ("color", "a", "001", 3.0, None, 2),
        ("color", "b", "001", 6.0, None, 3),
        ("scenes", "b", "", 7.0, None, 1),
    ]
    assert read_ledger(tmp_path).schema.equals(SCHEMA)


def test_rows_are_written_now_and_then(tmp_path: Path) -> None:
    ledger = Ledger(tmp_path, every=0)
    ledger.add(("inputs", "a", "001"), seconds=1.0)
    assert read_ledger(tmp_path).num_rows == 1


def test_a_ledger_is_inspected(tmp_path: Path) -> None:
    ledger = Ledger(tmp_path)
    for view in range(20):
        costs = {"seconds": 1.0 + view, "opening": 0.5, "peak_mb": 300.0 + view, "attempt": 1}
        ledger.add(("color", "a", f"{view:03}"), **costs, noise=0.1, bytes=10**6, worker="h:1")
    ledger.add(("scenes", "a", ""), seconds=2.0, attempt=2)
    ledger.save()
    inspection = inspect_path(ledger_path(tmp_path))
    made, color = inspection.sections["Stages"]
    assert (made["stage"], made["retried"], color["made"], color["MB"]) == ("scenes", 1, 20, 20.0)
    assert color["mean s"] == 10.5 and color["peak MB"] == 319 and color["opening"] == "5%"
    assert inspection.draw().shape[1] == 1200


def test_a_damaged_ledger_is_named_before_any_work(tmp_path: Path) -> None:
    ledger_path(tmp_path).write_bytes(b"PAR1 not what it was PAR1")
    with pytest.raises(InputError, match=r"ledger\.parquet: not a ledger of costs .* remove it"):
        Ledger(tmp_path)


def test_an_unknown_column_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="price"):
        Ledger(tmp_path).add(("color", "a", "001"), price=3)
