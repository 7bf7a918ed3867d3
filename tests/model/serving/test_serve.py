"""`pbrnet serve`: who is answered, what is dropped, and the page in a browser."""

import http.client
import json
import os
import re
import signal
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import numpy as np
import pytest

from pbrnet.model.evaluation.predict import ViewRenderer
from pbrnet.model.serving.gallery import Gallery, Shot, Shown, cameras_of
from pbrnet.model.serving.server import MAX_BODY, TOKEN_HEADER, PageServer
from pbrnet.model.serving.worker import NewestFirst, Superseded
from pbrnet.pipeline.images import png_bytes, read_picture
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.views import look
from pbrnet.scenes.contract import load_scene
from pbrnet.scenes.errors import InputError
from tests.fixtures import command
from tests.fixtures.browser import open_browser
from tests.fixtures.model import ROOM
from tests.fixtures.predict import box_camera, box_room

SHOT = {"eye": [1, 2, 1.5], "towards": [1, 0, -0.2], "method": "surfaces"}
CONTENT = {
    "scene": "</script><b>box",
    "folder": "data/scenes/box",
    "cameras": [{"name": "a", "eye": [0, 0, 1.5], "towards": [1, 0, 0]}],
    "methods": [("surfaces", "Draft"), ("radiosity", "Light")],
    "draft": "surfaces",
    "fov": 1.1,
}
Answer = tuple[int, http.client.HTTPMessage, bytes]


def painted(shot: Shot) -> Shown:
    """A picture whose colour tells direction and method: red by heading, blue for the draft."""
    if shot.towards[2] > 0.9:
        raise InputError("tilt\nthe camera")
    heading = np.arctan2(shot.towards[1], shot.towards[0])
    color = (int(128 + 80 * heading), 90, 200 if shot.method == "surfaces" else 20)
    return Shown(png_bytes(np.full((shot.height, shot.width, 3), color, np.uint8)), 0.01, 2.0)


@pytest.fixture()
def server() -> Iterator[PageServer]:
    """A server whose pictures are painted."""
    queue = NewestFirst(painted)
    server = PageServer(0, CONTENT, queue.ask)
    threads = [threading.Thread(target=run) for run in (queue.run, server.serve_forever)]
    for thread in threads:
        thread.start()
    yield server
    queue.end()
    server.shutdown()
    server.server_close()
    for thread in threads:
        thread.join(60)


def ask(
    server: PageServer,
    path: str = "/picture",
    body: Any = None,
    method: str = "POST",
    **changed: Any,
) -> Answer:
    """Answer to a request of the page; `changed` headers replace the right ones, None removes."""
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=60)
    content = body if isinstance(body, bytes) else json.dumps(body or SHOT).encode()
    headers = {
        "Host": f"127.0.0.1:{server.server_port}",
        TOKEN_HEADER: server.token,
        "Content-Length": str(len(content)),
        **{name.replace("_", "-"): value for name, value in changed.items()},
    }
    connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
    for name, value in headers.items():
        if value is not None:
            connection.putheader(name, value)
    connection.endheaders(content if method == "POST" else None)
    answer = connection.getresponse()
    found = answer.status, answer.headers, answer.read()
    connection.close()
    return found


def test_the_page_and_pictures_are_for_its_user_alone(server: PageServer) -> None:
    assert server.server_address[0] == "127.0.0.1"
    page = urlopen(server.url).read().decode()
    assert "<b>box" not in page and not re.search(r"(?:src|href)=|https?://", page)
    status, headers, content = ask(server)
    assert status == 200 and read_picture(content).shape == (240, 320, 3)
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    token = "X_Pbrnet_Token"
    for path, method, changed in (
        ("/", "GET", {token: None}),
        ("/?token=wrong", "GET", {token: None}),
        ("/picture", "POST", {token: None}),
        ("/picture", "POST", {token: "é"}),
        ("/picture", "POST", {"Host": f"evil.example:{server.server_port}"}),
        ("/picture", "POST", {"Host": None}),
        ("/picture", "POST", {"Origin": "http://evil.example"}),
        ("/picture", "POST", {"Origin": "null"}),
    ):
        status, _, content = ask(server, path, method=method, **changed)
        assert status == 403 and content.count(b"\n") == 1, (path, changed)
    tunnel = {"Host": "localhost:9000", "Origin": "http://localhost:9000"}
    assert ask(server, **tunnel)[0] == 200


@pytest.mark.parametrize(
    ("body", "changed", "status", "said"),
    [
        (b"{", {}, 400, "not valid JSON"),
        (b"[" * 3000, {}, 400, "not valid JSON"),
        ({**SHOT, "eye": [1, 2]}, {}, 400, "eye: expected 3 values"),
        ({**SHOT, "eye": [1, 2, 1e300]}, {}, 400, "eye"),
        ({**SHOT, "width": 10**6}, {}, 400, "width: 1000000 is not allowed"),
        ({**SHOT, "speed": 1}, {}, 400, "unknown key"),
        ({**SHOT, "towards": [0, 0, 1]}, {}, 422, r"tilt\nthe camera"),
        (b" " * (MAX_BODY + 1), {}, 413, "more than 4096 bytes"),
        (SHOT, {"Content_Length": None}, 411, "Content-Length"),
        (SHOT, {"Content_Length": "-1"}, 411, "Content-Length"),
        (SHOT, {"Content_Length": "9" * 5000}, 413, "more than"),
        (SHOT, {"path": "/etc/passwd"}, 404, "no such page"),
        (SHOT, {"method": "PUT"}, 405, "Unsupported method"),
        (SHOT, {"path": "/" + "a" * 70_000}, 414, "URI Too Long"),
    ],
)
def test_a_bad_request_ends_in_one_line(
    server: PageServer, body: Any, changed: dict[str, Any], status: int, said: str
) -> None:
    got, headers, content = ask(server, body=body, **changed)
    assert (got, content.count(b"\n")) == (status, 1) and said in content.decode()
    assert headers["Content-Type"].startswith("text/plain")
    assert ask(server)[0] == 200, "the next request is answered"


def test_the_newest_request_takes_the_place_of_the_one_that_waits() -> None:
    started, go = threading.Event(), threading.Event()
    drawn: list[str] = []

    def draw(shot: Shot) -> Shown:
        started.set()
        assert go.wait(60)
        drawn.append(shot.method)
        return Shown(b"", 0)

    queue = NewestFirst(draw)
    ends: dict[str, str] = {}

    def request(method: str) -> None:
        try:
            queue.ask(Shot((0, 0, 0), (1, 0, 0), method))
            ends[method] = "drawn"
        except Superseded:
            ends[method] = "dropped"

    worker = threading.Thread(target=queue.run)
    worker.start()
    askers = []
    for method, until in (
        ("first", started.is_set),
        ("second", lambda: queue._waiting),
        ("third", None),
    ):
        askers.append(threading.Thread(target=request, args=(method,)))
        askers[-1].start()
        while until and not until():
            pass
    askers[1].join(60)
    go.set()
    for asker in askers:
        asker.join(60)
    assert ends == {"first": "drawn", "second": "dropped", "third": "drawn"}
    assert drawn == ["first", "third"]
    queue.end()
    worker.join(60)
    with pytest.raises(Superseded):
        queue.ask(Shot((0, 0, 0), (1, 0, 0), "late"))


@pytest.fixture()
def box(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("params.yaml").write_text("{}\n")
    return box_room(Path("data"), box_camera("east", (24, 18), (0.5, 0.5, 1.5), (1, 0.2, -0.2)))


def test_pictures_are_those_of_predict(box: Path) -> None:
    gallery = Gallery(ViewRenderer(box, Params(), Path("data")), Path("none"))
    gallery.renderer.scene  # noqa: B018
    assert {"surfaces", "denoised"} <= set(gallery.methods) <= {"surfaces", "denoised", "radiosity"}
    shot = Shot((0.5, 0.5, 1.5), (1, 0.2, -0.2), "denoised", 36, 20)
    words = ("--eye=0.5,0.5,1.5", "--towards=1,0.2,-0.2", "--size", "36x20")
    command.printed("predict", box, *words, "--method", "denoised", "--out", "out.png")
    expected = read_picture(Path("out.png").read_bytes())
    assert np.array_equal(read_picture(gallery.draw(shot).png), expected)
    draft = gallery.draw(Shot(shot.eye, (1, 0, 0), "surfaces", 40, 30))
    assert draft.distance == pytest.approx(ROOM[0] - 0.5, abs=0.01)
    for wrong in (Shot(shot.eye, (0, 0, 1), "surfaces"), Shot(shot.eye, (1, 0, 0), "pbrnet")):
        with pytest.raises(InputError):
            gallery.draw(wrong)


def test_cameras_to_begin_with(box: Path) -> None:
    scene = load_scene(box)
    view = box_camera("east", (24, 18), (0.5, 0.5, 1.5), (1, 0, 0))
    (camera,) = cameras_of(scene, [view], np.zeros((2, 3)))
    assert camera["name"] == "east" and np.allclose(
        camera["towards"], look((0, 0, 0), (1, 0, 0))[:3, 2]
    )
    found = cameras_of(scene, [], np.array([[0, 0, 0], [2, 4, 2.0]]))
    assert len(found) == max(1, len(scene.rooms))


def test_the_command_prints_its_address_and_ends_with_ctrl_c(
    box: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers: list[int] = []
    serve_forever: Callable[..., None] = PageServer.serve_forever

    def visited(server: PageServer) -> None:
        def visit() -> None:
            body = {**SHOT, "width": 40, "height": 30}
            answers.extend((urlopen(server.url).status, ask(server, body=body)[0]))
            os.kill(os.getpid(), signal.SIGINT)

        threading.Thread(target=visit).start()
        serve_forever(server)

    monkeypatch.setattr(PageServer, "serve_forever", visited)
    before = signal.getsignal(signal.SIGINT)
    output = command.printed("serve", box, "--port", "0", "--models", "none")
    assert answers == [200, 200]
    assert re.search(r"Open http://127\.0\.0\.1:\d+/\?token=\S+\n", output)
    assert signal.getsignal(signal.SIGINT) is before
    taken = PageServer(0, CONTENT, lambda shot: painted(shot))
    assert command.exit_code("serve", box, "--port", taken.server_port) == 4
    taken.server_close()


SHOWN = "document.querySelector('figure[data-method={}]')?.dataset.state === '{}'"
COLOR = """(async () => {
  const image = document.querySelector('figure[data-method=radiosity] img');
  await image.decode();
  const canvas = document.createElement('canvas'), context = canvas.getContext('2d');
  context.drawImage(image, 0, 0, 1, 1);
  return [...context.getImageData(0, 0, 1, 1).data];
})()"""


@pytest.mark.slow
def test_dragging_and_keys_in_a_browser(server: PageServer, tmp_path: Path) -> None:
    with open_browser(tmp_path) as browser:
        browser.open(server.url)
        browser.until(SHOWN.format("radiosity", "final"))
        red, _, blue, _ = browser.script(COLOR)
        assert red == pytest.approx(128, abs=2) and blue < 60
        box = browser.script("document.querySelector('img').getBoundingClientRect().toJSON()")
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        mouse = {"y": y, "button": "left", "buttons": 1}
        browser.call("Input.dispatchMouseEvent", type="mousePressed", x=x, clickCount=1, **mouse)
        browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=x + 100, **mouse)
        browser.call("Input.dispatchMouseEvent", type="mouseReleased", x=x + 100, **mouse)
        turned = "camera.yaw > 0.05 && figures.get('radiosity').drawn === version"
        browser.until(turned)
        assert browser.script(COLOR)[0] > red + 3, "the scene follows the mouse"
        browser.press("w")
        browser.until("camera.eye[0] > 0.1 && figures.get('radiosity').drawn === version")
        browser.click("#methods button")
        browser.until(SHOWN.format("surfaces", "final"))
        assert browser.script("document.querySelectorAll('figure').length") == 2
        assert "--eye=0." in browser.script("document.querySelector('#command').textContent")
        assert browser.script("document.querySelector('#problem').textContent") == ""
        outside = [
            url for url in browser.requests() if f"127.0.0.1:{server.server_port}/" not in url
        ]
        assert not browser.errors() and not outside
