"""Where the logs of an array's units lie, without reading them."""

from __future__ import annotations

from pathlib import Path

from session.common.errors import FormatError
from session.files.toml import read_toml
from session.log.array_names import FOLDERS, array_section, unit_of
from session.log.array_reading import numbers_of, place_of
from session.log.folder import log_paths


def array_log_paths(folder: Path) -> dict[str, dict[int, Path]]:
    """Of each log and closure run, ``log0001`` and so on, the file of each unit by its number; folders' logs are paired in their order.

    FormatError where a folder is no array, or a log lacks a unit.
    """
    toml = folder / "session.toml"
    section = array_section(read_toml(toml)) if toml.exists() else None
    names = (section or {}).get(FOLDERS)
    found: dict[str, dict[int, Path]] = {}
    if isinstance(names, list) and names and all(isinstance(name, str) for name in names):
        numbers = numbers_of(toml, names)
        for number, name in sorted(zip(numbers, names, strict=True)):
            place = place_of(folder, toml, name)
            for stem in ("log", "closure"):
                for i, path in enumerate(log_paths(place, stem), 1):
                    found.setdefault(f"{stem}{i:04d}", {})[number] = path
        for which, paths in sorted(found.items()):
            if missing := [str(number) for number in sorted(numbers) if number not in paths]:
                raise FormatError(
                    f"{folder}: {which} lacks unit {', '.join(missing)}; every unit needs as many logs, and as many closure runs"
                )
    else:
        for path in [*log_paths(folder, "log"), *log_paths(folder, "closure")]:
            if (unit := unit_of(path)) is not None:
                found.setdefault(unit[0], {})[unit[1]] = path
    if not found:
        raise FormatError(f"{folder}: no array: it has neither log0001.unit0.csv and so on, nor [array] folders (docs/arrays.md)")
    return {which: dict(sorted(found[which].items())) for which in sorted(found)}
