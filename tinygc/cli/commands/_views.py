"""What a recording is looked at with: a live screen in a terminal, lines elsewhere, and a page where one was asked for."""

from __future__ import annotations

import argparse
import contextlib
import ipaddress
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING

from session.common.texts import printable

if TYPE_CHECKING:
    from session.guide.guided_session import Watch
    from session.guide.screen import LiveScreen, PlainLines
    from session.guide.view import View
    from session.page.server import PageServer

LOOPBACK = "127.0.0.1:0"


def page_address(text: str) -> tuple[str, int]:
    """``HOST:PORT`` or ``HOST``, an IPv4 address; port 0: any that is free."""
    host, _, port = text.partition(":")
    try:
        address, number = ipaddress.IPv4Address(host), int(port or 0)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no address of this computer, such as 127.0.0.1:8000") from None
    if not 0 <= number <= 65535:
        raise argparse.ArgumentTypeError(f"port {number} is none: 0 (any that is free) to 65535")
    if number == 80:
        raise argparse.ArgumentTypeError("port 80 is not to be had: browsers leave it out where the page wants it named; take 8080")
    return str(address), number


@contextlib.contextmanager
def page_server(args: argparse.Namespace) -> Iterator[PageServer | None]:
    """The page's server, where a page was asked for.  What ends the recording is said on the page, too."""
    if args.view is None:
        yield None
        return
    from session.common.errors import CalibrationError
    from session.page.server import PageServer

    server = PageServer(*args.view)
    server.start()
    print(f"look at the recording: {server.address}", file=sys.stderr, flush=True)  # also where quiet: it is what was asked for
    try:
        yield server
    except CalibrationError as error:
        server.publish("end", {"words": printable(str(error)), "command": "", "report": "none"})
        raise
    finally:
        server.close()


@contextlib.contextmanager
def views(args: argparse.Namespace, title: str, server: PageServer | None) -> Iterator[tuple[View, Watch | None]]:
    """What is told of the recording, and what is shown its samples."""
    with _screen(args, title) as screen:
        if server is None:
            yield screen, None
            return
        from session.page.view import PageView

        page = PageView(screen, server)
        yield page, page.watch


def _screen(args: argparse.Namespace, title: str) -> contextlib.AbstractContextManager[LiveScreen | PlainLines]:
    """The live screen in a terminal, lines elsewhere, nothing where quiet."""
    from session.common.console import PlainConsole
    from session.guide.screen import LiveScreen, PlainLines

    console = PlainConsole(stderr=True, quiet=args.quiet)
    return LiveScreen(title, args.mute, console) if console.is_terminal and not args.quiet else PlainLines(console)
