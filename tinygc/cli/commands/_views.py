"""What a recording is looked at with: a live screen in a terminal, lines elsewhere, and a page where one was asked for."""

from __future__ import annotations

import argparse
import contextlib
import ipaddress
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from session.guide.guided_session import Watch
    from session.guide.screen import LiveScreen, PlainLines
    from session.guide.view import View

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
    return str(address), number


@contextlib.contextmanager
def views(args: argparse.Namespace, title: str) -> Iterator[tuple[View, Watch | None]]:
    """What is told of the recording, and what is shown its samples."""
    with contextlib.ExitStack() as open_:
        if args.view is None:
            yield open_.enter_context(_screen(args, title)), None
            return
        from session.page.server import PageServer
        from session.page.view import PageView

        server = PageServer(*args.view)
        server.start()
        open_.callback(server.close)
        print(f"look at the recording: {server.address}", file=sys.stderr, flush=True)  # also where quiet: it is what was asked for
        page = PageView(open_.enter_context(_screen(args, title)), server)
        yield page, page.watch


def _screen(args: argparse.Namespace, title: str) -> LiveScreen | PlainLines:
    """The live screen in a terminal, lines elsewhere, nothing where quiet."""
    from session.common.console import PlainConsole
    from session.guide.screen import LiveScreen, PlainLines

    console = PlainConsole(stderr=True, quiet=args.quiet)
    return LiveScreen(title, args.mute, console) if console.is_terminal and not args.quiet else PlainLines(console)
