"""Requests to a page's server as a stranger would make them."""

import http.client
from urllib.parse import urlsplit


def answer(address: str, path: str, **headers: str) -> int:
    """Status of a request to the server."""
    connection = http.client.HTTPConnection("127.0.0.1", urlsplit(address).port, timeout=60)
    connection.request("GET", path, headers=headers)
    status = connection.getresponse().status
    connection.close()
    return status


def upgrade(origin: str) -> dict[str, str]:
    """Headers that ask for a websocket."""
    key = {"Sec-WebSocket-Key": "x3JJHMbDL1EzLkh9GBhXDw==", "Sec-WebSocket-Version": "13"}
    return {"Connection": "Upgrade", "Upgrade": "websocket", "Origin": origin, **key}


def is_shut(address: str) -> bool:
    """Whether who has no token sees nothing, and another origin cannot drive the page."""
    token = urlsplit(address).path
    strangers = answer(address, "/"), answer(address, "/calibration"), answer(address, "/ws")
    other = answer(address, f"{token}/ws", **upgrade("http://evil.example"))
    return len(token) > 30 and strangers == (404, 404, 404) and other == 403 and answer(address, token) == 200
