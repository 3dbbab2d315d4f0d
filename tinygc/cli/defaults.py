"""A user's defaults, from a file in the home folder: settings of a bench that would otherwise be typed each time.

The command line has priority, then a session's own session.toml, then this file.  A command that uses a value from it reports that in a
line and in its JSON.  The file never changes how an existing session is read: its values for the bench are copied into the session.toml
that ``record`` writes, so that the folder gives the same result everywhere.  Python programs do not read it.
"""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from session.base.errors import FormatError
from session.base.options import declared
from session.base.texts import printable, significant

SCHEMA = "tinygc-defaults/1"
NAME = "tinygc.toml"
#: names another file; empty: none
ENVIRONMENT = "TINYGC_DEFAULTS"


def place() -> Path | None:
    """Return the path of the file; None where the environment disables it."""
    named = os.environ.get(ENVIRONMENT)
    if named is not None:
        return Path(named) if named.strip() else None
    if sys.platform == "win32":
        base = os.environ.get("APPDATA", "")
    else:
        base = os.environ.get("XDG_CONFIG_HOME", "")
        base = base if os.path.isabs(base) else os.path.join(os.path.expanduser("~"), ".config")
    return Path(base) / NAME if os.path.isabs(base) else None


def take_defaults(options: Any) -> Any:
    """Return a command's options with those that the command line does not have from the file, and report these.

    A record may name by ``takes(known)`` which of its fields do, of the keys of the file.  Raises FormatError, with file and key, for an
    invalid file.
    """
    keys = {each.name: rule.default_key for each, rule in declared(options) if rule.default_key}
    path = place() if keys else None
    if path is None or not os.path.lexists(path):
        if path is not None and os.environ.get(ENVIRONMENT):
            raise FormatError(f"{path}: not found; {ENVIRONMENT} names it. Correct that, or leave it empty")
        return options
    known = _read(path)
    wanted = options.takes(known) if hasattr(options, "takes") else keys
    used = {name: known[keys[name]] for name in wanted if keys[name] in known and getattr(options, name) is None}
    if not used:
        return options
    values = {keys[name]: str(value) if isinstance(value, Path) else value for name, value in used.items()}
    if not options.quiet:
        text = ", ".join(f"{key} = {value}" for key, value in values.items())
        print(f"calibrate: {printable(f'of {path}: {text}')} ({ENVIRONMENT}= leaves it out)", file=sys.stderr)
    table: dict[str, Any] = {"file": str(path)}
    for key, value in values.items():
        section, name = key.split(".")
        table.setdefault(section, {})[name] = value
    return replace(options, **used, defaults=table)


def defaults_json(args: Any) -> dict:
    """Return the command's JSON entry for defaults, empty where none was used."""
    return {} if args.defaults is None else {"defaults": args.defaults}


def limit_text(args: Any) -> str:
    """Return ``--limit``, and its source if that is not the command line."""
    source = "" if args.defaults is None else f" (limits.closure_deg of {args.defaults['file']})"
    return f"--limit {significant(args.limit_deg)} deg{source}"


def _read(path: Path) -> dict[str, Any]:
    """Return key -> value of the keys that are present."""
    from session.base.records import record_of
    from session.base.results import Keys, Number, Text, require, unknown_keys
    from session.base.toml import read_toml
    from session.log.config import Site

    site = record_of(Site, null=False).may
    shape = Keys(
        must={"schema": Text((SCHEMA,))},
        may={
            "record": Keys(may={"like": Text(), "port": Text()}),
            "site": Keys(may={name: site[name] for name in ("latitude_deg", "gravity_mps2")}),
            "limits": Keys(may={"closure_deg": Number(1e-6, 180)}),
        },
    )
    table = read_toml(path)
    require(table, shape, str(path), "correct it there, or leave TINYGC_DEFAULTS empty")
    for key, near in unknown_keys(table, shape):
        meant = f"; did you mean {near}?" if near else ""
        print(f"calibrate: {printable(f'{path}: {key} is not known, and ignored{meant}')}", file=sys.stderr)
    sections = {name: inner for name, inner in shape.may.items() if isinstance(inner, Keys)}
    found = {f"{name}.{key}": table.get(name, {}).get(key) for name, inner in sections.items() for key in inner.may}
    if (like := found["record.like"]) is not None:
        found["record.like"] = path.parent / os.path.expanduser(like) if like.strip() else None
    numbers = {key: float(value) for key, value in found.items() if isinstance(value, int | float)}
    return {key: value for key, value in (found | numbers).items() if value not in (None, "")}
