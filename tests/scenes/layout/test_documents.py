"""The page on layouts: its example is a layout, and its schema is that of the reader."""

import json
import re
from pathlib import Path

from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.layout.building.plan import plan_of
from pbrnet.scenes.layout.checks import check_layout
from pbrnet.scenes.layout.furnishing.furnish import furnish_layout
from pbrnet.scenes.layout.readers import own
from pbrnet.scenes.procedural.furniture import make_style
from pbrnet.scenes.seeds import generator
from tests.fixtures.layout_schema import layout_schema
from tests.fixtures.paths import ROOT

PAGE = (ROOT / "docs" / "layouts.md").read_text(encoding="utf-8")


def test_the_example_is_a_layout_without_a_change() -> None:
    found = re.search(r"```json\n(.*?)```", PAGE, re.DOTALL)
    assert found is not None
    layout = check_layout(own.read(json.loads(found[1]), Path("flat.layout.json")))
    changes = Changes()
    plan, _ = plan_of(layout, -0.3, changes)
    assert [room.type for room in plan.rooms] == ["living", "bathroom", "hall"]
    assert len(plan.openings) == len(layout.openings) and not changes.sentences()


def test_the_example_file_fills_its_boxes() -> None:
    path = ROOT / "examples" / "flat.layout.json"
    layout = check_layout(own.read(json.loads(path.read_text(encoding="utf-8")), path))
    changes = Changes()
    plan, _ = plan_of(layout, -0.3, changes)
    style = make_style(generator(5, "style"), "scandinavian")
    made = furnish_layout(generator(0), layout, plan, style, None, changes)
    assert made.record["median_iou"] >= 0.95 and made.record["plain_boxes"] == 1
    assert len(plan.openings) == len(layout.openings)
    assert not any("reach" in text or "door" in text for text in changes.sentences())


def test_the_schema_beside_the_page_is_that_of_the_reader() -> None:
    stored = json.loads((ROOT / "docs" / "layout.schema.json").read_text(encoding="utf-8"))
    assert stored == layout_schema()


def test_the_page_names_every_key() -> None:
    for cls in (own.OwnLayout, own.OwnRoom, own.OwnOpening, own.OwnObject):
        for key in cls.__dataclass_fields__:
            assert f"`{key}`" in PAGE or key in ("pbrnet", "version"), key
