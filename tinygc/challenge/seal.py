"""Close the truth away: a file that nobody can read without the key, which only the examiner's memory holds until the end.

The SHA-256 of the truth is printed before anything is explained, and checked when the file is opened: neither can be changed between.
"""

from __future__ import annotations

import hashlib
import json
import secrets
from dataclasses import dataclass
from pathlib import Path

from session.common.errors import DataError
from session.files.reading import MOST_JSON, read_bytes

KEY_BYTES = 32


@dataclass(frozen=True)
class Seal:
    """path of the sealed file; sha256 of the truth as text; the key."""

    path: Path
    sha256: str
    key: bytes

    def open(self) -> dict:
        """The truth.  Raises DataError if the file is not the one that was sealed."""
        text = _masked(read_bytes(self.path, MOST_JSON), self.key)
        if hashlib.sha256(text).hexdigest() != self.sha256:
            raise DataError(f"{self.path}: this is not the truth that was sealed; its SHA-256 has changed")
        return json.loads(text)


def seal(truth: dict, path: Path) -> Seal:
    """Write the truth, JSON-ready, unreadable."""
    text = (json.dumps(truth, indent=1, ensure_ascii=False) + "\n").encode()
    key = secrets.token_bytes(KEY_BYTES)
    path.write_bytes(_masked(text, key))
    return Seal(path, hashlib.sha256(text).hexdigest(), key)


def _masked(data: bytes, key: bytes) -> bytes:
    """One-time pad: the key is used for one file only."""
    pad = hashlib.shake_256(key).digest(len(data))
    return bytes(a ^ b for a, b in zip(data, pad, strict=True))
