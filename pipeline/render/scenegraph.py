"""Scene graph of a `scene.xml`: parsed nodes and the Mitsuba objects made from them.

Nothing is merged, and every shape keeps its id. Mitsuba's own parser reads the file; this module
instantiates it node by node, for three reasons. Images are read without Mitsuba's EXR code (which
hangs when its thread pool has one thread), every BSDF can have twins (neutral, reflectance) that
share its textures, and errors name the element they come from.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from pbrnet.pipeline.render.bsdf_calls import keep_from_calls
from pbrnet.pipeline.render.variants import on_card
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.formats.scene_xml import check_scene_xml
from pbrnet.scenes.image_files import UnreadableImage, exr_channels

# Rendering settings in a scene file, which the stages override.
_NOT_BUILT = ("Sensor", "Integrator", "Sampler", "Film", "ReconstructionFilter")


@dataclass(frozen=True)
class Graph:
    """Parsed nodes of one scene file and the objects made from them.

    `nodes[0]` is the scene. Property values that refer to another node are
    `mi.Properties.ResolvedReference`. Objects are made on first use and cached.
    """

    xml: Path
    state: Any  # mi.parser.ParserState
    made: dict[int, Any]

    @property
    def nodes(self) -> Any:
        """All nodes (`mi.parser.SceneNode`), by index."""
        return self.state.nodes

    def plugin(self, index: int) -> str:
        """Return the plugin's name, e.g. "roughconductor"."""
        return str(self.nodes[index].props.plugin_name())

    def kind(self, index: int) -> str:
        """Return the kind of object, e.g. "BSDF", "Texture", "Shape", "Emitter"."""
        return self._kinds[index]

    @cached_property
    def _kinds(self) -> list[str]:
        return [str(node.type).rpartition(".")[2] for node in self.nodes]

    def props(self, index: int) -> Any:
        """Return a copy of a node's properties (`mi.Properties`)."""
        return mi.Properties(self.nodes[index].props)

    def references(self, index: int) -> dict[str, int]:
        """Return property name -> node index, for the properties that are nodes themselves."""
        if index not in self._references:
            props = self.nodes[index].props
            values = {key: props[key] for key in props.keys()}  # noqa: SIM118 (not iterable)
            self._references[index] = {
                key: value.index()
                for key, value in values.items()
                if isinstance(value, mi.Properties.ResolvedReference)
            }
        return self._references[index]

    @cached_property
    def _references(self) -> dict[int, dict[str, int]]:
        return {}

    def nested(self, index: int, kind: str) -> list[int]:
        """Return the nodes of one kind that a node holds directly, in the file's order."""
        return [child for child in self.references(index).values() if self.kind(child) == kind]

    def make(self, index: int) -> Any:
        """Return the object of a node, made on first use; raises `InputError`."""
        if index not in self.made:
            self.made[index] = self.make_from(index, self.props(index))
        return self.made[index]

    def make_from(self, index: int, props: Any) -> Any:
        """Make a new object for a node, with these properties; raises `InputError`."""
        for key in list(props.keys()):
            value = props[key]
            if isinstance(value, mi.Properties.ResolvedReference):
                if self.kind(value.index()) in _NOT_BUILT:
                    del props[key]
                else:
                    props[key] = self.make(value.index())
            else:
                props[key] = value  # set again: the read above would count as a use
        if "filename" in props:
            self._resolve_file(index, props)
        try:
            return self.compose(props)
        except RuntimeError as error:
            raise InputError(f"{self.where(index)}: {_first_words(error)}") from None

    def leaf(self, index: int) -> Any:
        """Return the BSDF of a node with 0.5 instead of each texture, for its constants.

        No shape has it, and no call meets it.
        """
        props = self.props(index)
        for name, child in self.references(index).items():
            if self.kind(child) == "Texture":
                props[name] = 0.5
        made = self.make_from(index, props)
        keep_from_calls(made)
        return made

    def compose(self, props: Any) -> Any:
        """Return `create(props)`; if a BSDF, those that it holds are kept from virtual calls."""
        made = create(props)
        if isinstance(made, mi.BSDF):
            on_shapes = {self.made[node].ptr for node in self.shaders if node in self.made}
            values = [props[key] for key in props.keys()]  # noqa: SIM118 (as above)
            for value in values:
                if isinstance(value, mi.BSDF) and value.ptr not in on_shapes:
                    keep_from_calls(value)
        return made

    @cached_property
    def shaders(self) -> frozenset[int]:
        """The BSDF nodes that a shape holds directly."""
        nodes = range(len(self.nodes))
        shapes = [node for node in nodes if self.kind(node) == "Shape"]
        return frozenset(bsdf for shape in shapes for bsdf in self.nested(shape, "BSDF"))

    def where(self, index: int) -> str:
        """Return file, line and element of a node, for error messages."""
        node = self.nodes[index]
        try:
            place = str(mi.parser.file_location(self.state, node))
        except RuntimeError:
            place = str(self.xml)
        name = f" {node.props.id()!r}" if node.props.id() else ""
        return f"{place}: {self.kind(index).lower()} of type {self.plugin(index)!r}{name}"

    def _resolve_file(self, index: int, props: Any) -> None:
        path = self.xml.parent / str(props["filename"])
        if not path.is_file():
            raise InputError(f"{self.where(index)}: the file {path} is missing")
        if path.suffix.lower() == ".exr" and self.kind(index) in ("Texture", "Emitter"):
            del props["filename"]
            props["bitmap"] = mi.Bitmap(read_exr(path))
        else:
            props["filename"] = str(path)


def parse(xml: Path) -> Graph:
    """Parse `scene.xml`; raises `InputError` with file and line if it is broken."""
    if not Path(xml).exists():
        raise InputError(f"{xml}: no such scene file")
    check_scene_xml(Path(xml))
    config = mi.parser.ParserConfig(mi.variant())
    config.merge_meshes = False
    config.merge_equivalent = False
    config.parallel = False
    try:
        state = mi.parser.parse_file(config, str(xml))
        mi.parser.transform_all(config, state)
    except RuntimeError as error:
        raise InputError(f"{xml}: {_first_words(error)}") from None
    if not len(state.nodes) or str(state.nodes[0].type).rpartition(".")[2] != "Scene":
        raise InputError(f"{xml}: the outermost element is not <scene>")
    if not on_card():  # whose ray tracer has no such choice
        # Without it, a ray that is aimed at an edge may slip between two triangles, others with
        # AVX2 than with AVX-512.
        state.nodes[0].props["embree_use_robust_intersections"] = True
    return Graph(Path(xml), state, {})


def create(props: Any) -> Any:
    """Make one Mitsuba object from complete properties; raises RuntimeError as Mitsuba does."""
    made = mi.PluginManager.instance().create_object(props)
    unused = list(props.unqueried())
    if unused:
        raise RuntimeError(f"unknown property {unused[0]!r}")
    expanded = made.expand()
    return expanded[0] if len(expanded) == 1 else made


def shapes_of(graph: Graph) -> Iterator[int]:
    """Yield the nodes of all shapes, those in shape groups included, in the file's order."""
    for index in range(len(graph.nodes)):
        if graph.kind(index) == "Shape":
            yield index


def read_exr(path: Path) -> np.ndarray:
    """Read an EXR image as float32 (H, W, C), C = 1, 3 or 4; raises `InputError` if damaged."""
    try:
        channels = exr_channels(path)
    except UnreadableImage as error:
        raise InputError(f"{path}: damaged or truncated EXR ({error})") from None
    for names in (("R", "G", "B", "A"), ("R", "G", "B"), ("Y",)):
        if all(name in channels for name in names):
            return np.stack([channels[name].astype(np.float32) for name in names], axis=-1)
    raise InputError(f"{path}: an EXR image without colour channels (it has {', '.join(channels)})")


def _first_words(error: Exception) -> str:
    """Return Mitsuba's message without its log decoration, on one line."""
    text = re.sub(r"^.*?\[[\w.:]+\]\s*", "", str(error).strip(), count=1, flags=re.DOTALL)
    return " ".join((text or str(error)).split())[:600]
