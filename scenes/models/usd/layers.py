"""Layers of a USD stage: checked to lie in the scene's folder before OpenUSD composes them.

Runs in the child process that holds OpenUSD.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pxr import Ar, Sdf, Tf, Usd

from pbrnet.scenes.errors import InputError

_MOST_LAYERS = 20_000
_QUOTED = re.compile(r" : '(.*?)'\s*(?:\n\tError|$)", re.DOTALL)


@dataclass
class Layers:
    """The layers that a stage consists of: files that were found, and names of missing ones."""

    root: Path  # folder that all layers lie in
    found: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)

    def open_stage(self, path: Path) -> Any:
        """Return the `Usd.Stage` of the file at `path` with all its payloads.

        Raises `InputError` for damaged files and for layers outside of `root`.
        """
        pending, seen = [path], {path}
        first = None
        while pending:
            layer = self._read(pending.pop(), path)
            if layer is None:
                continue
            first = first or layer
            for name in sorted(layer.GetCompositionAssetDependencies()):
                target = self._target(layer, name)
                if target not in seen and len(seen) > _MOST_LAYERS:
                    raise InputError(f"{path}: more than {_MOST_LAYERS:,} layers")
                if target not in seen:
                    seen.add(target)
                    pending.append(target)
        if first is None:
            raise InputError(f"{path}: damaged USD file")
        try:
            stage = Usd.Stage.Open(first, Usd.Stage.LoadAll)
        except Tf.ErrorException as error:
            raise InputError(f"{path}: damaged USD file ({reason(error, path)})") from None
        return stage

    def _target(self, layer: Any, name: str) -> Path:
        written = layer.ComputeAbsolutePath(name) if name else ""
        outer, _ = Ar.SplitPackageRelativePathOuter(written)
        # A search path that is not found beside the layer stays relative.
        target = (Path(layer.realPath).parent / outer).resolve()
        if not target.is_relative_to(self.root):
            raise InputError(
                f"{layer.identifier}: {name!r} lies outside the scene's folder {self.root}; "
                "move the file into it, or give a folder that contains both with --root"
            )
        return target

    def _read(self, path: Path, scene: Path) -> Any:
        """Return the layer in a file; None, noted in `missing`, without one of a known format."""
        if not path.is_file() or (path != scene and not Sdf.FileFormat.FindByExtension(str(path))):
            self.missing.append(str(path))
            return None
        try:
            layer = Sdf.Layer.FindOrOpen(str(path))
        except Tf.ErrorException as error:
            raise InputError(f"{path}: damaged USD file ({reason(error, path)})") from None
        if layer is None:
            raise InputError(f"{path}: damaged USD file, or a layer of another format")
        self.found.append(str(path))
        return layer


def reason(error: Exception, path: Path) -> str:
    """Return the message of OpenUSD without the places in its own code and the name of the file."""
    found = _QUOTED.search(str(error).replace(f"{path}:", "line "))
    return " ".join((found[1] if found else type(error).__name__).split())[:200]
