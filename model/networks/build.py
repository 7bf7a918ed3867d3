"""Networks of architectures, and the revisions of their code."""

from __future__ import annotations

from torch import nn

from pbrnet.model.methods import METHODS
from pbrnet.model.networks.pbrnet import Architecture
from pbrnet.pipeline.keys import table
from pbrnet.scenes.checked import imported
from pbrnet.scenes.errors import InputError

_BUILDERS = {method.kind: method.build for method in METHODS.values()}


def revision_of(kind: str) -> int:
    """Return the revision of a kind of network: its key, raised when earlier weights do not fit."""
    return table()[f"networks.{kind}"]


def build_network(architecture: Architecture) -> nn.Module:
    """Build the network of an architecture, initialised from torch's random state.

    Raises `InputError` for a kind that no method has.
    """
    if architecture.kind not in _BUILDERS:
        known = ", ".join(_BUILDERS)
        raise InputError(f"no network of the kind {architecture.kind!r}; known are: {known}")
    network: nn.Module = imported(_BUILDERS[architecture.kind])(architecture)
    return network


def is_current(architecture: Architecture) -> bool:
    """Test whether the network's code still has the form that weights were trained for."""
    kind = architecture.kind
    return kind not in _BUILDERS or revision_of(kind) == architecture.revision
