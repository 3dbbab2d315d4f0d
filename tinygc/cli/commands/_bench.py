"""What ``record`` takes of a person's own defaults: the port, and what a session.toml that it writes is to say of the bench."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from session.log.config import Site

PORT, LIKE = {"port": "record.port"}, {"like": "record.like"}
SITE = {"latitude_deg": "site.latitude_deg", "gravity_mps2": "site.gravity_mps2"}
DEFAULTS = PORT | LIKE | SITE


def takes(args: argparse.Namespace, known: Mapping[str, object]) -> dict[str, str]:
    """Destination -> key of what counts for this recording; known: the keys that the file has.

    A folder's own session.toml says all of it already; another one that the recording is to be like says where the table stands.
    """
    if args.out is not None and (args.out / "session.toml").exists():
        return PORT
    if args.like is not None:
        return PORT
    return PORT | (LIKE if LIKE["like"] in known else SITE)


def bench(args: argparse.Namespace) -> Site:
    """Where the table stands, by these defaults."""
    from session.log.config import Site

    return Site(args.latitude_deg, args.gravity_mps2)
