"""Map tiles beneath a route: only where a user names a server, which then learns where the survey is."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING
from urllib.error import URLError
from urllib.parse import urlsplit
from urllib.request import Request, urlopen

import numpy as np
from numpy.typing import NDArray

from vision.contract.errors import InputError
from vision.contract.frame import LocalFrame

if TYPE_CHECKING:
    from solver.run.seen import Seen

Array = NDArray[np.float64]

#: px across the picture, of a tile, and m that a pixel at the equator covers at zoom 0 (Web Mercator).
ACROSS, TILE, EQUATOR = 900, 256, 156543.034
#: Tiles and zoom at most: what is finer shows nothing of a street that matters here.
MOST, FINEST = 48, 19
#: s that a tile may take, and bytes that it may have.
PATIENCE, LARGEST = 10.0, 2_000_000
AGENT = "roadfiber workbench"
#: m of ground around the route.
MARGIN = 25.0


@dataclass(frozen=True, eq=False)
class Beneath:
    """A picture of the ground.

    Parameters
    ----------
    image : [row, column], packed RGBA, x to the right and y growing with the row
    low, high : its corners (x, y), m
    host : that gave the tiles
    """

    image: NDArray[np.uint32]
    low: tuple[float, float]
    high: tuple[float, float]
    host: str


def host_of(address: str) -> str:
    """The server of a tile address.

    Raises
    ------
    InputError
        If it is no address of tiles.

    >>> host_of("https://tile.openstreetmap.org/{z}/{x}/{y}.png")
    'tile.openstreetmap.org'
    """
    parts = urlsplit(address)
    if parts.scheme not in ("http", "https") or not all(one in address for one in ("{z}", "{x}", "{y}")):
        raise InputError(
            f"--tiles {address}: give an address such as https://tile.openstreetmap.org/{{z}}/{{x}}/{{y}}.png"
        )
    return parts.netloc


def places(latitude: Array, longitude: Array) -> tuple[Array, Array]:
    """Web Mercator of latitude and longitude, degrees: east and south, 0 to 1 over the world."""
    south = (1 - np.arcsinh(np.tan(np.radians(latitude))) / np.pi) / 2
    return (np.asarray(longitude) + 180) / 360, south


def fetched(address: str) -> NDArray[np.uint8]:
    """One tile [TILE, TILE, 3], BGR; InputError where there is none."""
    import cv2

    try:
        with urlopen(Request(address, headers={"User-Agent": AGENT}), timeout=PATIENCE) as answer:
            content = answer.read(LARGEST)
    except (URLError, OSError, ValueError) as error:
        raise InputError(f"map tiles: {address}: {getattr(error, 'reason', error)}") from error
    image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise InputError(f"map tiles: {address}: not a picture")
    return np.asarray(cv2.resize(image, (TILE, TILE)), np.uint8)


def beneath(
    frame: LocalFrame,
    low: tuple[float, float],
    high: tuple[float, float],
    address: str,
    fetch: Callable[[str], NDArray[np.uint8]] = fetched,
) -> Beneath:
    """The ground between two corners, m, turned as the local frame is.

    Parameters
    ----------
    frame : of x and y
    low, high : corners (x, y), m
    address : of tiles, with {z}, {x} and {y}
    fetch : gives a tile by its address

    Raises
    ------
    InputError
        If a tile cannot be had.
    """
    host = host_of(address)
    span = np.subtract(high, low)
    rows = max(1, round(ACROSS * span[1] / span[0]))
    x, y = np.meshgrid(
        low[0] + (np.arange(ACROSS) + 0.5) * span[0] / ACROSS, low[1] + (np.arange(rows) + 0.5) * span[1] / rows
    )
    latitude, longitude = frame.to_geographic(x.ravel(), y.ravel())
    east, south = places(latitude, longitude)
    wanted = np.log2(EQUATOR * np.cos(np.radians(latitude.mean())) * ACROSS / span[0])
    for zoom in range(min(FINEST, int(np.ceil(wanted))), -1, -1):
        column, row = (np.floor(one * 2**zoom).astype(int) for one in (east, south))
        numbers = np.unique(np.stack([column, row], 1), axis=0)
        if len(numbers) <= MOST:
            break
    names = [address.replace("{z}", str(zoom)).replace("{x}", str(c)).replace("{y}", str(r)) for c, r in numbers]
    with ThreadPoolExecutor(4) as pool:
        tiles = dict(zip(map(tuple, numbers.tolist()), pool.map(fetch, names), strict=True))
    image = np.full((len(east), 4), 255, np.uint8)
    across, down = ((one * 2**zoom % 1 * TILE).astype(int) for one in (east, south))
    for (c, r), tile in tiles.items():
        here = (column == c) & (row == r)
        image[here, :3] = tile[down[here], across[here], ::-1]
    return Beneath(image.view(np.uint32).reshape(rows, ACROSS), low, high, host)


def around(run: "Seen", address: str) -> Beneath:
    """The ground around the route and the vehicles near it; InputError where there are no tiles."""
    route = run.result.route[run.result.constrained] if run.result.constrained.any() else run.result.route
    low, high = route[:, :2].min(axis=0) - MARGIN, route[:, :2].max(axis=0) + MARGIN
    return beneath(run.frame, (float(low[0]), float(low[1])), (float(high[0]), float(high[1])), address)
