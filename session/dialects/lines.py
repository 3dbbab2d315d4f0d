"""The lines of a text file, plain or gzipped, in pieces: whatever its line ends, and as far as it goes."""

from __future__ import annotations

import codecs
import io
import re
import zlib
from pathlib import Path
from typing import Any

from session.common.errors import FormatError

#: in the place of a file name: standard input
STANDARD = "-"
GZIP = b"\x1f\x8b"
PIECE_BYTES = 1 << 20
#: as a piece: the whole file
ALL_BYTES = 1 << 62
READ_BYTES = 1 << 17
#: packed bytes that are lost at most before the place where a packed file is damaged
SLICE_BYTES = 1 << 12


class Lines:
    """``take()`` gives the next lines, without their ends, and an empty list at the end; ``note`` says if the file breaks off;
    ``comments``: the ``key=value`` words of the comment lines so far, a later one in the place of an earlier."""

    def __init__(self, path: Path):
        """Raises FormatError for what cannot be opened."""
        self._path, self.note = path, ""
        self.comments: dict[str, str] = {}
        try:
            self._file = open(0, "rb", closefd=False) if str(path) == STANDARD else path.open("rb")  # noqa: SIM115
            # A stream has no name that tells.
            packed = path.suffix.lower() == ".gz" or (not path.is_file() and self._file.peek(2)[:2] == GZIP)
        except OSError as error:
            raise FormatError(f"{path}: cannot be read ({error.strerror or error})") from None
        self._unpack = _Unpack() if packed else None
        self._decode = io.IncrementalNewlineDecoder(codecs.getincrementaldecoder("utf-8-sig")(errors="replace"), translate=True)
        self._rest, self._ended = "", False

    def take(self, size: int = PIECE_BYTES) -> list[str]:
        """The lines of about ``size`` bytes, at least one."""
        parts, taken = [self._rest], len(self._rest)
        while not self._ended and (taken < size or "\n" not in parts[-1]):
            data = self._read()
            self._ended = not data
            parts.append(self._decode.decode(data, final=self._ended))
            taken += len(parts[-1])
        text = "".join(parts)
        if self._ended:
            self._rest = ""
            self._heed(text)
            return text.removesuffix("\n").split("\n") if text else []
        whole, _, self._rest = text.rpartition("\n")
        self._heed(whole)
        return whole.split("\n")

    @property
    def position(self) -> int:
        """Bytes of the file, as it lies on the disk, that were read so far; of a stream, none."""
        if not self._path.is_file():
            return 0
        return self._file.tell() if not self._file.closed else self._path.stat().st_size

    def give_back(self, lines: list[str]) -> None:
        """Let ``take`` begin with these lines, which it gave."""
        self._rest = "".join(f"{line}\n" for line in lines) + self._rest

    def close(self) -> None:
        """Let go of the file."""
        self._file.close()

    def __enter__(self) -> Lines:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _heed(self, text: str) -> None:
        if "#" in text:
            said = re.findall(r"^[^\S\n]*#(.*)$", text, re.M)
            self.comments |= dict(pair for line in said for pair in re.findall(r"(\w+)=(\S+)", line))

    def _read(self) -> bytes:
        """Some bytes of text; none at the end."""
        try:
            if self._unpack is None:
                return self._file.read1(READ_BYTES)
            while packed := self._file.read1(READ_BYTES):
                if data := self._unpack(packed):
                    return data
                if self._unpack.broken:
                    break
        except OSError as error:
            raise FormatError(f"{self._path}: cannot be read ({error.strerror or error})") from None
        if self._unpack.whole:
            return b""
        if not self._unpack.gave:
            raise FormatError(f"{self._path.name}: not a gzip file, or a damaged one; unpack it or give it its right name")
        self.note = "the compressed file breaks off: the part before is used"
        return b""


class _Unpack:
    """gzip, member after member, as far as it is sound.  broken: something in it was not; whole: it ended where it should."""

    def __init__(self) -> None:
        self._member: Any = None  # of zlib.decompressobj, whose class has no public name
        self.gave = self.broken = False

    @property
    def whole(self) -> bool:
        return self._member is None and not self.broken

    def __call__(self, packed: bytes) -> bytes:
        parts = []
        try:
            for start in range(0, len(packed) if not self.broken else 0, SLICE_BYTES):
                rest = packed[start : start + SLICE_BYTES]
                while rest := rest if self._member else rest.lstrip(b"\0"):  # zeros may pad what is behind a member
                    self._member = self._member or zlib.decompressobj(wbits=31)
                    parts.append(self._member.decompress(rest))
                    rest = self._member.unused_data
                    self._member = None if self._member.eof else self._member
        except zlib.error:
            self.broken = True
        data = b"".join(parts)
        self.gave |= bool(data)
        return data
