"""The key of a result: SHA-256 over everything that it follows from.  A folder that was moved or copied has the key that it had."""

from __future__ import annotations

import hashlib
import os
import re
from pathlib import Path

from session.common.errors import FormatError
from session.common.version import VERSION
from session.log.hashes import file_key, sha256_of
from tinygc.fleet.options import FleetOptions

#: names of files that a session is read from, on any system; truth.json, raw.bin and what commands derived are not among them
INPUTS = re.compile(r"session\.toml|raw\.times|attitudes\.csv|turns\.csv|(log|closure|rest|truth).*\.csv(\.gz)?", re.IGNORECASE | re.DOTALL)
#: how a key is made
KEY = "fleet key 1"


def key_of(folder: Path, options: FleetOptions) -> str:
    """In hexadecimal: of the format of keys, the tool's version, the options, and name and SHA-256 of each input, by name.

    FormatError for a folder or a file that cannot be read: without it nobody knows what a result would be of.
    """
    digest = hashlib.sha256(f"{KEY}\n{VERSION}\n{options.text}\n".encode())
    for path in input_paths(folder):
        digest.update(f"{file_key(path)}\0{sha256_of(path)}\n".encode())
    return digest.hexdigest()


def input_paths(folder: Path) -> list[Path]:
    """By name.  FormatError where the folder cannot be looked into, or holds none."""
    try:
        names = sorted(name for name in os.listdir(folder) if INPUTS.fullmatch(name))
    except OSError as error:
        raise FormatError(f"{folder}: {error.strerror}; expected a session folder") from None
    except ValueError:  # a list may have any bytes in it
        raise FormatError(f"{folder}: is no name of a folder; expected a session folder") from None
    if not names:
        raise FormatError(f"{folder}: holds neither session.toml nor a log; expected a session folder")
    return [folder / name for name in names]
