"""Training data by physically based rendering, and networks that imitate the renderer.

The public interface; names are imported on first use. `docs/api.md` documents them.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pbrnet.model.data.reader import Dataset as Dataset
    from pbrnet.pipeline.dataset.parquet import decode_image as decode_image
    from pbrnet.pipeline.inspection.renders import render_view as render_view
    from pbrnet.pipeline.inspection.renders import view_at as view_at
    from pbrnet.pipeline.params import Params as Params
    from pbrnet.pipeline.params import load_params as load_params
    from pbrnet.pipeline.photograph import photograph as photograph
    from pbrnet.pipeline.tonemap import ToneParams as ToneParams
    from pbrnet.pipeline.tonemap import exposure_of as exposure_of
    from pbrnet.pipeline.tonemap import tonemap as tonemap
    from pbrnet.pipeline.views import View as View
    from pbrnet.pipeline.views import load_cameras as load_cameras
    from pbrnet.scenes.contract import Scene as Scene
    from pbrnet.scenes.contract import load_scene as load_scene
    from pbrnet.scenes.errors import PbrnetError as PbrnetError
    from pbrnet.scenes.registry import import_scene as import_scene

_HOMES = {
    "Dataset": "model.data.reader",
    "Params": "pipeline.params",
    "PbrnetError": "scenes.errors",
    "Scene": "scenes.contract",
    "ToneParams": "pipeline.tonemap",
    "View": "pipeline.views",
    "decode_image": "pipeline.dataset.parquet",
    "exposure_of": "pipeline.tonemap",
    "import_scene": "scenes.registry",
    "load_cameras": "pipeline.views",
    "load_params": "pipeline.params",
    "load_scene": "scenes.contract",
    "photograph": "pipeline.photograph",
    "render_view": "pipeline.inspection.renders",
    "tonemap": "pipeline.tonemap",
    "view_at": "pipeline.inspection.renders",
}
__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    """Import a public name (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module 'pbrnet' has no attribute {name!r}")
    found = globals()[name] = getattr(importlib.import_module(f"pbrnet.{_HOMES[name]}"), name)
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
