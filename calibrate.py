#!/usr/bin/env python3
"""Calibrate a MEMS gyroscope on a hand-turned table: the command line.

Parses arguments, runs one command (``tinygc/cli/commands``, a file each), turns its errors into one line and an exit code.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import sys
from typing import Any

try:
    import tinygc  # noqa: F401  # refuses a foreign ``session`` before anything is imported from it
except ImportError as error:
    print(f"calibrate: {error}", file=sys.stderr)
    sys.exit(2)

from session.base.errors import CalibrationError
from tinygc.cli.arguments import joined, options_of, parser
from tinygc.cli.results import complain, ended_by_signals, silence, standard_output, state_changes


def main(arguments: list[str] | None = None) -> int:
    """Run one command; returns the exit code (docs/formats.md, exit codes)."""
    _make_streams_safe()
    # Many small matrices: on a machine that is busy with other work, threads that wait for one another cost more than they give.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        with ended_by_signals():
            words = sys.argv[1:] if arguments is None else arguments
            if not words:  # who types the name alone asks what there is; a script whose variable is empty must not take it for done
                parser(["--help"]).print_help()
                return 2
            words = joined(words)
            args = parser(words).parse_args(words)
            code = _run(args)
            with standard_output():
                sys.stdout.flush()
        return code
    except CalibrationError as error:
        complain(str(error))
        return error.exit_code
    except KeyboardInterrupt:
        complain("interrupted")
        return 130
    except OSError as error:
        try:
            sys.stdout.flush()
        except OSError:
            silence(sys.stdout.fileno())
        complain(f"{f'{error.filename}: ' if error.filename else ''}{error.strerror or error}")
        return 2


def _run(args: argparse.Namespace) -> int:
    """With the effects of the folders that were named, and no others, in the catalogue."""
    options = options_of(args)
    with contextlib.ExitStack() as named:
        if getattr(options, "effects", None):
            from tinygc.effects import using

            named.enter_context(using(options.effects))
        code = args.run(options)
    state_changes(options)
    return code


def _make_streams_safe() -> None:
    """Whoever started us may have closed a stream, may read it in an encoding without our signs, or may stop reading it: none is worth a
    traceback, nor another exit code."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        buffer = getattr(stream, "buffer", None)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        elif stream is getattr(sys, f"__{name}__") and type(raw := getattr(buffer, "raw", buffer)) is io.FileIO:
            stream.flush()
            file = _WhileRead(stream.fileno(), "wb", closefd=False)
            own = file if buffer is raw else io.BufferedWriter(file)  # python -u has no buffer
            how = {"line_buffering": stream.line_buffering, "write_through": stream.write_through}
            setattr(sys, name, io.TextIOWrapper(own, stream.encoding, "replace", **how))
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")


class _WhileRead(io.FileIO):
    """A stream whose reader may go: what is left goes nowhere, and the command goes on to its verdict."""

    def write(self, data: Any, /) -> int:
        """Write, or lose."""
        try:
            return super().write(data)
        except BrokenPipeError:
            silence(self.fileno())
            return super().write(data)


if __name__ == "__main__":
    sys.exit(main())
