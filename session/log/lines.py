"""The lines of a text file, plain or gzipped, in pieces: with any line ends, and never more of it than the caller takes.

A file may be made, or may have broken, so that it holds gigabytes without a row: a line that does not end, zero bytes, blank lines, a
packed file that is a thousand times smaller than what comes out of it.  Each of these ends in a FormatError after some megabytes.
"""

from __future__ import annotations

import codecs
import gzip
import io
import re
import zlib
from pathlib import Path

from session.base.errors import FormatError
from session.base.files import MB, open_file, open_stream, unreadable

#: what begins UTF-16, and its description
UTF_16, UTF_16_NOTE = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE), "UTF-16: read as text"
#: the note on a file of which no one knows how much is lost
BREAKS_OFF = "the compressed file breaks off: the part before is used"


def _windows(error: UnicodeError) -> tuple[str, int]:
    """What is no UTF-8 is a letter of Windows' own code, as in ``°/s``."""
    assert isinstance(error, UnicodeDecodeError)  # it is for reading alone
    return error.object[error.start : error.end].decode("cp1252", "replace"), error.end


codecs.register_error("cp1252", _windows)

#: in the place of a file name: standard input
STANDARD = "-"
GZIP = b"\x1f\x8b"
PIECE_BYTES = 1 << 20
READ_BYTES = 1 << 17
#: unpacked bytes that are lost at most before the place where a packed file is damaged
SLICE_BYTES = 1 << 14
#: characters of a line: a row of a phone's log with everything switched on has some hundreds
LONGEST_LINE = 1 << 16
#: characters of blank lines and comments between two rows: an hour of a board that only talks
MOST_BARREN = 4 * MB
#: zero bytes that may end a file: what a card had reserved, or had not written, when the power failed
MOST_ZEROS = 16 * MB
#: ``key=value`` words that are remembered of the comments: who needs one knows its key, and it stands at the top
MOST_WORDS = 1000
#: a line that is neither blank nor a comment begins
ROW = re.compile(r"^[^\S\n]*[^\s#]", re.M)
#: ``key=value``; from the beginning of a word, or a long word without = would be looked at from each of its letters
WORD = re.compile(r"\b(\w++)=(\S+)")
TERMINATED = re.compile("(?<!\0)\0++(?=\n)")
COMMENT = re.compile(r"^[^\S\n]*+#(.*)$", re.M)


class Lines:
    """``take()`` gives the next lines, without their ends, and an empty list at the end; ``note`` is there if the file breaks off;
    ``comments``: the ``key=value`` words of the comment lines so far, a later one in the place of an earlier."""

    def __init__(self, path: Path, strict: bool = False):
        """strict: what is no UTF-8 and what breaks off is refused, not replaced and noted.

        Raises FormatError for what cannot be opened: anything but a file, or what was opened for us (``session/base/files.py``).
        """
        self._path, self._strict, self.note = path, strict, ""
        self.comments: dict[str, str] = {}
        stream = open_stream(path)
        self.once = stream is not None  # it cannot be opened again
        self._file = open_file(path) if stream is None else stream
        try:
            # A stream has no name that shows it.
            packed = path.suffix.lower() == ".gz" or (self.once and self._file.peek(2)[:2] == GZIP)
        except OSError as error:
            raise unreadable(path, error) from None
        self._packed = gzip.GzipFile(fileobj=self._file) if packed else None
        self._gave = False  # whether any of it could be unpacked
        self._decode: io.IncrementalNewlineDecoder | None = None  # until the first bytes are there
        self._rest, self._ended, self._wide = "", False, False
        self._number = 1  # of the line that ``_rest`` begins with
        self._barren = self._zeros = 0

    def take(self, size: int = PIECE_BYTES) -> list[str]:
        """The lines of about ``size`` bytes, at least one.  FormatError for a line, or a gap between rows, that is beyond any log."""
        parts, taken = [self._rest], len(self._rest)
        open_line = taken  # characters since the last line's end
        while not self._ended and (taken < size or "\n" not in parts[-1]):
            data = self._read()
            self._ended = not data
            try:
                part = self._decoder(data).decode(data, final=self._ended)
            except UnicodeDecodeError:
                raise FormatError(f"{self._path}: not UTF-8 text; save it as CSV in UTF-8") from None
            end = part.rfind("\n")
            open_line = open_line + len(part) if end < 0 else len(part) - end - 1
            parts.append(part)
            taken += len(part)
            if open_line > LONGEST_LINE:
                self._refuse_line("".join(parts))
            self._require_rows(part)
        text = "".join(parts)
        if "\0\n" in text:  # a string's terminator before the line's end
            text = TERMINATED.sub("", text)
        whole, _, self._rest = (text, "", "") if self._ended else text.rpartition("\n")
        if "#" in whole:
            for line in COMMENT.findall(whole):
                for key, value in WORD.findall(line) if "=" in line and len(line) <= LONGEST_LINE else []:
                    if key in self.comments or len(self.comments) < MOST_WORDS:
                        self.comments[key] = value
        lines = (whole.removesuffix("\n") if self._ended else whole).split("\n") if text else []
        if lines and max(map(len, lines)) > LONGEST_LINE:
            self._refuse_line(whole)
        self._number += len(lines)
        return lines

    @property
    def position(self) -> int:
        """Bytes of the file, as it lies on the disk, that were read so far; of a stream, none."""
        if self.once:
            return 0
        return self._file.tell() if not self._file.closed else self._path.stat().st_size

    def give_back(self, lines: list[str]) -> None:
        """Let ``take`` begin with these lines, which it gave."""
        self._rest = "".join(f"{line}\n" for line in lines) + self._rest
        self._number -= len(lines)

    def close(self) -> None:
        """Let go of the file."""
        self._file.close()

    def __enter__(self) -> Lines:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _refuse_line(self, text: str) -> None:
        """text: from the beginning of the line ``_number``."""
        before = 0
        for line in text.split("\n"):
            if len(line) > LONGEST_LINE:
                break
            before += 1
        raise FormatError(
            f"{self._path.name} line {self._number + before}: longer than {LONGEST_LINE} characters; expected CSV, a sample a line; "
            "is it a text log?"
        )

    def _require_rows(self, part: str) -> None:
        """part of the text that begins anywhere in a line."""
        begin = part.find("\n") + 1
        if ROW.search(part, begin):
            self._barren = 0
            return
        self._barren += len(part)
        if self._barren > MOST_BARREN:
            raise FormatError(f"{self._path.name}: no row among {MOST_BARREN} characters, but blank lines or comments; expected samples")

    def _decoder(self, data: bytes) -> io.IncrementalNewlineDecoder:
        """Of UTF-8, or, where the first bytes are its mark, of UTF-16, as Windows' programs write it; strict: of UTF-8 alone."""
        if self._decode is None:
            self._wide = data.startswith(UTF_16) and not self._strict
            codec = codecs.getincrementaldecoder("utf-16" if self._wide else "utf-8-sig")
            self.note = UTF_16_NOTE if self._wide else self.note
            self._decode = io.IncrementalNewlineDecoder(codec("strict" if self._strict else "cp1252"), translate=True)
        return self._decode

    def _read(self) -> bytes:
        """Some bytes of text; none at the end.  Of a run of zero bytes that ends what was read, one."""
        while (data := self._read_any()) and not data[-1]:
            if self._wide or (self._decode is None and data.startswith(UTF_16)):
                return data  # half of a letter
            sound = data.rstrip(b"\0")
            before = 0 if sound else self._zeros
            self._zeros = before + len(data) - len(sound)
            if self._zeros > MOST_ZEROS:
                raise FormatError(self._zeros_words())
            if sound or not before:
                return sound + b"\0"
        self._zeros = 0
        return data

    def _zeros_words(self) -> str:
        name, cut = self._path.name, "cut it there" if self._packed is None else "unpack it, and cut it there"
        if self._packed is None and not self.once:
            begin = self._file.tell() - self._zeros
            if not begin:
                return f"{name}: begins with {self._zeros} zero bytes; expected a text log"
            cut = f"cut it there: truncate -s {begin}"
        return f"{name}: goes over into more than {MOST_ZEROS} zero bytes (the power failed, or the logger had reserved space); {cut}"

    def _read_any(self) -> bytes:
        try:
            if self._packed is None:
                return self._file.read1(READ_BYTES) or b""
            data = self._packed.read1(SLICE_BYTES)
            self._gave |= bool(data)
            return data
        except (EOFError, zlib.error, gzip.BadGzipFile):
            pass  # as far as it is sound
        except OSError as error:
            raise unreadable(self._path, error) from None
        if not self._gave:
            raise FormatError(f"{self._path.name}: not a gzip file, or a damaged one; unpack it or give it its right name")
        if self._strict:
            raise FormatError(f"{self._path.name}: the compressed file is broken; pack it again")
        self.note = BREAKS_OFF
        return b""
