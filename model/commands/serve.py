"""`pbrnet serve`: a page on this machine with a camera to move and the pictures of the methods."""

from __future__ import annotations

import shlex
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

import click

from pbrnet.model.evaluation.predict import ViewRenderer
from pbrnet.model.options import found_models_option
from pbrnet.model.serving.gallery import SURFACES, TITLES, Gallery, cameras_of
from pbrnet.model.serving.server import ADDRESS, PageServer
from pbrnet.model.serving.worker import NewestFirst
from pbrnet.pipeline.commands.options import FILE, FOLDER, Request, common_options
from pbrnet.pipeline.lenses.settings import STEEPEST
from pbrnet.pipeline.terminal import say
from pbrnet.pipeline.views import View, load_cameras
from pbrnet.scenes.errors import InputError, MachineError
from pbrnet.scenes.files import exists


@click.command(
    epilog="""\b
Examples:
  pbrnet serve data/scenes/home-0000
  pbrnet serve data/scenes/my-home --port 0           any free port
  pbrnet serve data/scenes/my-home --models models/fine

Open the printed address in a browser on this machine; it contains a token that the page needs. From
another machine: ssh -L 8765:127.0.0.1:8765 HOST. Ctrl-C ends the server.
The page begins with the views of the camera file, or with a view of each room. It loads nothing
from elsewhere and works offline."""
)
@click.argument("scene", type=FOLDER)
@click.option(
    "--camera",
    type=FILE,
    help="Camera file of the scene.  [default: data/cameras/SCENE.json, if it exists]",
)
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=8765,
    help=f"Port on {ADDRESS}; 0: any free port.",
)
@found_models_option()
@common_options
def serve(
    request: Request, scene: Path, camera: Path | None, port: int, models: Path | None
) -> int:
    """Show a scene in the browser: move the camera and compare methods."""
    renderer = ViewRenderer(scene, request.params, request.data)
    opened = renderer.scene
    gallery = Gallery(renderer, models)
    views = _views(opened.scene.scene_id, camera, request.data / "cameras" / f"{scene.name}.json")
    content = {
        "scene": opened.scene.scene_id,
        "folder": shlex.quote(str(scene)),
        "cameras": cameras_of(opened.scene, views, opened.bbox),
        "methods": [(name, TITLES[name]) for name in gallery.methods],
        "draft": SURFACES,
        "fov": 2 * min(request.params.image.half_fov_x, STEEPEST),
    }
    queue = NewestFirst(gallery.draw)
    try:
        server = PageServer(port, content, queue.ask)
    except OSError as error:
        hint = "give another --port, or 0 for a free one"
        raise MachineError(f"{ADDRESS}:{port}: {error.strerror}; {hint}") from None
    say(f"Methods: {', '.join(gallery.methods)}", f"Open {server.url}", "Ctrl-C ends the server.")
    threading.Thread(target=server.serve_forever, name="server", daemon=True).start()
    with _ended_by_signal(queue):
        queue.run()
    server.shutdown()
    server.server_close()
    return 0


@contextmanager
def _ended_by_signal(queue: NewestFirst) -> Iterator[None]:
    """Let Ctrl-C end the queue after the picture in progress; a second one ends the process.

    An exception from within native code could leave its threads waiting for ever.
    """

    def end(number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        say("", "Ending after the picture in progress; Ctrl-C again ends at once.", err=True)
        queue.end()

    before = signal.signal(signal.SIGINT, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _views(scene_id: str, camera: Path | None, usual: Path) -> tuple[View, ...]:
    """Views of the scene's camera file; none if none is given and the usual one is missing."""
    if camera is None and not exists(usual):
        return ()
    path = camera or usual
    cameras = load_cameras(path)
    if cameras.scene_id != scene_id:
        raise InputError(f"{path}: cameras of {cameras.scene_id!r}, not of {scene_id!r}")
    return cameras.views
