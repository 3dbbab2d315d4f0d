"""The lines of a text file, plain or gzipped, in pieces: whatever its line ends, and as far as it goes."""

from __future__ import annotations

import codecs
import gzip
import io
import zlib
from pathlib import Path

from session.common.errors import FormatError

#: in the place of a file name: standard input
STANDARD = "-"
GZIP = b"\x1f\x8b"
PIECE_BYTES = 1 << 20
READ_BYTES = 1 << 17


class Lines:
    """``take()`` gives the next lines, without their ends, and an empty list at the end; ``note`` says if the file breaks off."""

    def __init__(self, path: Path):
        """Raises FormatError for what cannot be opened."""
        self._path, self.note = path, ""
        try:
            raw = open(0, "rb", closefd=False) if str(path) == STANDARD else path.open("rb")  # noqa: SIM115
            # A stream has no name that tells.
            packed = path.suffix.lower() == ".gz" or (not path.is_file() and raw.peek(2)[:2] == GZIP)
        except OSError as error:
            raise FormatError(f"{path}: cannot be read ({error.strerror or error})") from None
        self._file = gzip.GzipFile(fileobj=raw) if packed else raw
        self._raw = raw
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
            return text.removesuffix("\n").split("\n") if text else []
        whole, _, self._rest = text.rpartition("\n")
        return whole.split("\n")

    @property
    def position(self) -> int:
        """Bytes of the file, as it lies on the disk, that were read so far; of a stream, none."""
        if not self._path.is_file():
            return 0
        return self._raw.tell() if not self._raw.closed else self._path.stat().st_size

    def give_back(self, lines: list[str]) -> None:
        """Let ``take`` begin with these lines, which it gave."""
        self._rest = "".join(f"{line}\n" for line in lines) + self._rest

    def close(self) -> None:
        self._file.close()
        self._raw.close()

    def __enter__(self) -> Lines:
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def _read(self) -> bytes:
        try:
            return self._file.read1(READ_BYTES)
        except gzip.BadGzipFile:
            raise FormatError(f"{self._path.name}: not a gzip file, or a damaged one; unpack it or give it its right name") from None
        except (EOFError, zlib.error):
            self.note = "the compressed file breaks off: the part before is used"
            return b""
        except OSError as error:
            raise FormatError(f"{self._path}: cannot be read ({error.strerror or error})") from None
