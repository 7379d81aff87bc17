"""Map tiles beneath the route: asked of no server but the named one, and laid where they belong."""

import threading
from http.server import BaseHTTPRequestHandler, HTTPServer
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from roadfiber.web import tiles
from roadfiber.web.figures import RouteMap
from roadfiber.web.tiles import TILE, around, beneath, host_of, places
from vision.contract import InputError, LocalFrame

LOW, HIGH = (-40.0, -20.0), (60.0, 30.0)


class Handler(BaseHTTPRequestHandler):
    """Gives tiles whose green and red say how far east and south of the origin's tile each is."""

    def do_GET(self):
        self.server.asked.append(self.path)
        zoom, column, row = (int(part) for part in self.path.removesuffix(".png").split("/")[1:])
        east, south = (int(one[0] * 2**zoom) for one in places(*np.array(self.server.origin)[:, None]))
        image = np.zeros((TILE, TILE, 3), np.uint8)
        image[..., 1], image[..., 2] = 100 + 10 * (column - east), 100 + 10 * (row - south)
        self.send_response(self.server.status)
        self.end_headers()
        self.wfile.write(cv2.imencode(".png", image)[1].tobytes())

    def log_message(self, *given):
        """Say nothing."""


@pytest.fixture
def server():
    with HTTPServer(("127.0.0.1", 0), Handler) as server:
        server.asked, server.origin, server.status = [], (32.0, 34.8), 200
        server.address = f"http://127.0.0.1:{server.server_port}/{{z}}/{{x}}/{{y}}.png"
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


@pytest.mark.parametrize("azimuth", [90.0, 0.0, 215.0])
def test_tiles_lie_where_they_belong_however_the_frame_is_turned(server, azimuth):
    frame = LocalFrame(server.origin, azimuth)
    ground = beneath(frame, LOW, HIGH, server.address)
    rows, columns = ground.image.shape
    colors = ground.image.view(np.uint8).reshape(rows, columns, 4)
    zoom = int(server.asked[0].split("/")[1])
    for row, column in [(3, 5), (rows - 4, 7), (rows // 2, columns - 9)]:
        x = LOW[0] + (column + 0.5) * (HIGH[0] - LOW[0]) / columns
        y = LOW[1] + (row + 0.5) * (HIGH[1] - LOW[1]) / rows
        east, south = (np.floor(one * 2**zoom) for one in places(*frame.to_geographic([x], [y])))
        first = [np.floor(one * 2**zoom) for one in places(*np.array(server.origin)[:, None])]
        expected = [100 + 10 * (south - first[1])[0], 100 + 10 * (east - first[0])[0]]
        assert colors[row, column, :2].tolist() == expected
    assert len(server.asked) == len(set(server.asked)) <= tiles.MOST


def test_the_map_says_whose_tiles_it_shows(server):
    route = np.column_stack([np.arange(50.0), np.full(50, 4.0), np.ones(50)])
    result = SimpleNamespace(route=route, constrained=np.ones(50, bool))
    drawn = RouteMap(lambda x, y: None)
    drawn.beneath(around(SimpleNamespace(frame=LocalFrame(server.origin, 90.0), result=result), server.address))
    assert drawn.plot.title.text == f"From above, on map tiles of 127.0.0.1:{server.server_port}"
    assert drawn.ground.data["x"] == [-tiles.MARGIN] and drawn.ground.data["dw"] == [49 + 2 * tiles.MARGIN]


def test_a_server_without_tiles_is_a_line(server):
    server.status = 404
    with pytest.raises(InputError, match="Not Found"):
        beneath(LocalFrame(server.origin, 90.0), LOW, HIGH, server.address)


@pytest.mark.parametrize("address", ["file:///tmp/{z}/{x}/{y}", "https://tiles.example/map.png", "none"])
def test_only_an_address_of_tiles_is_asked(address):
    with pytest.raises(InputError, match="give an address such as"):
        host_of(address)
