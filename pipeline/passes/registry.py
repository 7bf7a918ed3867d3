"""Traces: what is rendered together, from which settings, and under which fingerprint.

A trace makes frames of one or more kinds of a view. It reads the settings of these kinds and no
other parameter, and a frame's fingerprint is a digest of its settings, of the keys of its code,
the view's camera and size, the scene's content, the renderer and the seed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from pbrnet.pipeline.channels import SURFACES, Kind
from pbrnet.pipeline.frames import Result, camera_of, fingerprint
from pbrnet.pipeline.keys import keys
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.passes import environment, transport, truth, visibility
from pbrnet.pipeline.passes.surfaces import render_surfaces
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.views import View
from pbrnet.scenes.seeds import derive

S = TypeVar("S")


@dataclass(frozen=True)
class Trace(Generic[S]):
    """Frames of a view that are rendered together.

    `keys` names for each kind the keys (`keys.yaml`) of the code that makes it. `settings` returns
    by kind all that `render` may read of the parameters; `render` makes the kinds whose settings it
    is given, each with the same bits alone and with others. `seed` names the trace's random
    numbers, "" if it uses none. Kinds for which `together` is False are rendered one by one; those
    for which `moves` is True depend on the neighbours in a trajectory.
    """

    keys: dict[Kind, tuple[str, ...]]
    settings: Callable[[Params], dict[Kind, S]]
    render: Callable[[RenderScene, View, Mapping[Kind, S], int], dict[Kind, Result]]
    seed: str = ""
    together: Callable[[S], bool] = lambda settings: True
    moves: Callable[[S], bool] = lambda settings: False

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """Kinds of frames that the trace makes."""
        return tuple(self.keys)


_TRUTH = ("groundtruth", "inputs")  # inputs guide the denoiser
SEEN: Trace[Any] = Trace(
    {kind: (kind, "inputs") for kind in SURFACES},
    lambda params: dict.fromkeys(SURFACES),  # they depend on the view alone
    render_surfaces,
)
LIGHTS = Trace(
    {"illumination": ("illumination",), "visibility": ("visibility", "illumination", "inputs")},
    lambda params: visibility.settings(params.illumination),
    visibility.render_lights,
)
TRACES: tuple[Trace[Any], ...] = (
    SEEN,
    LIGHTS,
    Trace(
        {"shading": _TRUTH, "color": _TRUTH, "light": ("light", *_TRUTH)},
        lambda of: truth.truth_settings(of.groundtruth, of.shading, of.light, of.optics),
        truth.render_truths,
        seed="truth",
        together=lambda settings: settings.trace.joint and not settings.optics,
        moves=lambda settings: settings.moves,
    ),
    # Of other samples: a network that sees the ground truth's own would learn its noise.
    Trace(
        {"noisy": (*_TRUTH, "guides")},
        lambda of: truth.noisy_settings(of.groundtruth, of.shading, of.noisy, of.optics),
        truth.render_noisy,
        seed="noisy",
        moves=lambda settings: settings.moves,
    ),
    Trace(
        {"environment": ("environment", *_TRUTH)},
        lambda params: environment.settings(params.groundtruth, params.environment),
        environment.render_environment,
        seed="environment",
    ),
    Trace(
        {"transport": ("transport", "guides")},
        lambda params: transport.settings(params.transport),
        lambda scene, view, own, seed: {
            "transport": transport.render_transport(scene, view, own["transport"].transport, seed)
        },
        seed="transport",
    ),
)
# Traces of what networks take for a picture; the seed is the root seed.
QUICK: tuple[Trace[Any], ...] = (
    SEEN,
    LIGHTS,
    Trace(
        {"transport": ("transport", "guides"), "noisy": (*_TRUTH, "guides")},
        lambda of: {
            "transport": of.transport,
            "noisy": truth.noisy_trace(of.groundtruth, of.noisy.spp),
        },
        transport.render_quick,
    ),
)
TRACE_OF: dict[Kind, Trace[Any]] = {kind: trace for trace in TRACES for kind in trace.kinds}


def settings_of(params: Params, kinds: Iterable[Kind]) -> dict[Kind, Any]:
    """Return the settings of these kinds, each from its trace."""
    return {kind: TRACE_OF[kind].settings(params)[kind] for kind in kinds}


def render(
    scene: RenderScene, view: View, settings: Mapping[Kind, Any], seed: int
) -> dict[Kind, Result]:
    """Render frames of one trace: channels and entries of the attribute, by kind.

    `settings`: of the kinds to render, see `settings_of`. `seed` is the view's own, see
    `trace_seed`. Raises `InputError` where they cannot be rendered.
    """
    return TRACE_OF[next(iter(settings))].render(scene, view, settings, seed)


def trace_seed(kind: Kind, view: View, root: int) -> int:
    """Return the seed of a kind's trace of one view, derived from the root seed.

    Kinds of one trace share it.
    """
    name = TRACE_OF[kind].seed or kind
    return derive(root, "scene", view.scene_id, "view", view.view_id, name)


def frame_fingerprint(
    kind: Kind, view: View, settings: Any, root_seed: int, scene_digest: str, renderer: str
) -> str:
    """Return the fingerprint of a frame with these settings; see this module's docstring."""
    trace = TRACE_OF[kind]
    return fingerprint(
        kind=kind,
        keys=keys(*trace.keys[kind]),
        settings=settings,
        view=camera_of(view, kind, trace.moves(settings)),
        scene=scene_digest,
        renderer=renderer,
        seed=trace_seed(kind, view, root_seed) if trace.seed else None,
    )
