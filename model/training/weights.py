"""Writing of weights as `.safetensors`, by rename."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import save_file

from pbrnet.scenes.errors import MachineError
from pbrnet.scenes.files import atomic_file


def write_weights(path: Path, state: dict[str, torch.Tensor]) -> None:
    """Write a `.safetensors` file by rename; raises `MachineError` where the disk is full."""
    with atomic_file(path) as partial:
        try:
            save_file(state, partial)
        except SafetensorError as error:
            if "os error 28" in str(error):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)) from None
            raise MachineError(f"{path}: cannot be written ({error})") from None
