"""A page that this machine serves to itself alone: on 127.0.0.1, at an address that nobody can guess."""

import secrets
import threading
from collections.abc import Callable
from typing import Any

from vision.contract import InputError

#: Bytes of the token in an address.
TOKEN = 24
#: s that open pages have to show why serving ends.
LAST_WORDS = 2.0


def serve(
    page: Callable[[], Any],
    name: str,
    *,
    port: int,
    browser: bool,
    title: str,
    token: str | None = None,
    work: Callable[[], None] | None = None,
) -> None:
    """Serve a page until Ctrl-C ends it.

    Every browser gets a page of its own. Pages of other origins can neither read it, for want of its address, nor open
    its websocket, whose origin is checked. Scripts and styles come from here, not from the web.

    Parameters
    ----------
    page : makes what Panel shows, once for each browser
    name : of what is served, as the terminal calls it
    port : 0 for any
    browser : open the user's browser
    title : of the page
    token : part of the address; a new one where None
    work : done in a thread once the address is told; what it raises ends the serving, and is raised here

    Raises
    ------
    InputError
        If the port cannot be used.
    """
    import panel as pn
    from bokeh.models import CustomJS

    token = token or secrets.token_urlsafe(TOKEN)

    def served() -> Any:
        document = pn.state.curdoc
        if document is not None:
            document.js_on_event("connection_lost", CustomJS(code=LOST))
        return page()

    pn.config.raw_css = []
    try:
        # `localhost` and the port that is found are the only origin that Bokeh takes by itself.
        server = pn.io.server.get_server(
            {token: served}, port=port, address="127.0.0.1", title=title, start=False, show=False, use_index=False
        )
    except OSError as error:
        raise InputError(f"--port {port}: {error.strerror}; give another, or 0 for any") from error
    address = f"http://localhost:{server.port}/{token}"
    print(f"{name}: {address}  (Ctrl-C ends it)", flush=True)
    if browser:
        server.io_loop.add_callback(server.show, f"/{token}")
    server.start()
    raised: list[BaseException] = []

    def beside(work: Callable[[], None]) -> None:
        try:
            work()
        except BaseException as error:
            raised.append(error)
            server.io_loop.add_callback(lambda: server.io_loop.call_later(LAST_WORDS, server.io_loop.stop))

    if work is not None:
        threading.Thread(target=beside, args=(work,), daemon=True).start()
    try:
        server.io_loop.start()
    except KeyboardInterrupt:
        print("ended")
    finally:
        server.stop()
    if raised:
        raise raised[0]


#: Says on the page that the server has ended.
LOST = """
    if (document.getElementById('roadfiber-lost')) return
    const line = document.createElement('p')
    line.id = 'roadfiber-lost'
    line.setAttribute('role', 'alert')
    line.style = 'position:fixed;top:0;left:0;right:0;margin:0;padding:10px 16px;background:#a84800;color:white;' +
        'font:15px system-ui,sans-serif;z-index:9999'
    line.textContent = 'The server has stopped, so this page no longer answers. All that was written is in its ' +
        'folders; a fit that was under way is discarded. Start the command again to go on.'
    document.body.append(line)
"""
