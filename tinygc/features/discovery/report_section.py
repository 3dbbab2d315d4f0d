"""Discoveries in a calibration report: what an earlier ``explain --discover`` found, and the section that shows it."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from session.base.errors import FormatError
from session.base.files import MB, read_bytes
from session.base.records import record_of
from session.base.results import Array, Keys, ListOf, MapOf, Maybe, Number, Text, read_required, require
from session.base.texts import command_line
from tinygc.explanation.reported import ReportData
from tinygc.features.discovery.result import discovery_facts
from tinygc.features.discovery.search_state import HeldOut
from tinygc.reporting.facts import html
from tinygc.reporting.html.markup import Section, code, paragraph

#: the section of the report that this one stands behind
BEHIND = "explanation"

# Read what an earlier ``explain --discover`` of this session found beyond the catalogue, without running its files.

DO = "explain again, or remove it"
#: bytes of discover.svg, which has some 100 kB
MOST_PICTURE = 8 * MB
SVG = b"<svg xmlns="
_RIVAL = Keys({"id": Maybe(Text()), "equation": Text(), "worse_by": Number(), "correlation": Number(), "discriminating_motion": Text()})
_LAW = Keys(
    {
        **dict.fromkeys(("id", "equation", "in_words", "unit"), Text()),
        **dict.fromkeys(("chi_square", "better_by", "chance_p"), Number()),
        "constants": MapOf(Keys({"value": Number(), "sigma": Maybe(Number()), "unit": Text()})),
        "held_out": ListOf(record_of(HeldOut)),
        "file": Maybe(Text()),
        "same_here": ListOf(Text()),
        "runners_up": ListOf(_RIVAL),
        "learnable_from": Maybe(Number()),
    },
    {"terms": ListOf(Text()), "not_observed": ListOf(Keys({"in_words": Text()}))},
)
_DISCOVERY = Keys(
    {
        "verdict": Text(("found", "ambiguous", "none")),
        "why": Text(),
        "laws": ListOf(_LAW),
        "catalogue_effects": ListOf(Keys({"id": Text()})),
        "forms": Number(0, whole=True),
        "distinct": Number(0, whole=True),
        "learnable": MapOf(Keys({"size_dps": Maybe(Number())})),
    }
)
SHAPE = Keys({"schema": Text(("tinygc-explain/2",))}, {"next": Maybe(Text()), "logs": MapOf(Text()), "discovery": _DISCOVERY})


@dataclass(frozen=True, eq=False)
class SavedDiscovery:
    """folder of the explanation; table: its ``discovery``; following: what to do next, or empty; picture: discover.svg, or None."""

    folder: Path
    table: dict
    following: str
    picture: bytes | None


def searched(folder: Path, logs: Mapping[str, str]) -> SavedDiscovery | None:
    """Read the folder of ``explain`` in a session; logs: the hashes of the session's logs by name.

    None where nothing was searched, or in other logs.  FormatError for an explanation that cannot be read.
    """
    where = folder / "explain"
    path = where / "explain.json"
    if not path.exists():
        return None
    explained = read_required(path, SHAPE, DO)
    table = explained.get("discovery")
    if table is None or explained.get("logs") != dict(logs):
        return None
    for number, law in enumerate(table["laws"]):
        _require_numbers(law, f"{path.name}: discovery.laws[{number}]")
    return SavedDiscovery(where, table, explained.get("next") or "", _picture(where / "discover.svg") if table["laws"] else None)


def _require_numbers(law: dict, where: str) -> None:
    """Require coefficients and their sigmas: one for each axis, or a row for each."""
    for name in ("parameters", "std"):
        require(law.get(name), MapOf(Array((3,)) if _is_flat(law.get(name)) else Array((3, None))), f"{where}.{name}", DO)
    if not all(np.shape(law["std"].get(name)) == np.shape(values) for name, values in law["parameters"].items()):
        raise FormatError(f"{where}.std is not of its parameters; {DO}")


def _is_flat(table: object) -> bool:
    first = next(iter(table.values()), None) if isinstance(table, dict) else None
    return not (isinstance(first, list) and first and isinstance(first[0], list))


def _picture(path: Path) -> bytes | None:
    """An SVG small enough for a page, which shows it as an image: nothing in it runs."""
    try:
        data = read_bytes(path, MOST_PICTURE) if path.is_file() else b""
    except FormatError:
        return None
    return data if data.startswith(SVG) else None


# Report section on laws beyond the catalogue: the equations of an ``explain --discover``, their evidence, and their use.


def section(evidence: ReportData) -> Section | None:
    """The section, or None where nothing was searched."""
    found = evidence.searched
    if found is None:
        return None
    parts = html(discovery_facts(found.table, found.following))
    if found.picture is not None:
        data = b64encode(found.picture).decode()
        caption = "Left: what is missed without the law, with the law through it. Right: what it leaves."
        parts += (
            f'<figure><img src="data:image/svg+xml;base64,{data}" alt="The remainder against the law, and what the law leaves">'
            f"<figcaption>{caption}</figcaption></figure>"
        )
    if found.table["laws"]:
        use = command_line("explain", "OTHER", "--effects", found.folder / "effects")
        parts += paragraph("The law as an effect, in another session:") + code(use)
    return Section("discovery", "Beyond the catalogue", parts)
