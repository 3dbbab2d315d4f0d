"""Names of real recordings, checked on the unit's other recordings; prints what docs/measured/explain.md has below ``<!-- checked -->``.

    python benchmarks/checked_recordings.py [mimu euroc broad] [--only UNIT …] [--out FILE]

Every session of a unit is explained by itself; each name that it states is then predicted in each of the unit's other sessions with the
numbers of the first (``tinygc.explanation.checked``).  A name counts by what the sessions that can show it say: contradicted in one of them
is contradicted.  Sets: mimu is eight units in four experiments of ../shared/mimu and two of ../shared/wild/mimu; euroc is one unit in all
sequences; broad is one unit in two trials.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from common import in_parallel

from session.io.errors import CalibrationError

SHARED = Path(__file__).resolve().parents[2] / "shared"
SETS = ("mimu", "euroc", "broad")
#: probability from which on a name is stated with confidence
CONFIDENT = 0.95


@dataclass(frozen=True)
class Unit:
    set_name: str
    name: str
    folders: tuple[Path, ...]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sets", nargs="*", metavar="SET", default=[], help=f"of {', '.join(SETS)} (all)")
    parser.add_argument("--only", nargs="+", default=[], metavar="UNIT", help="only these units, such as u0")
    parser.add_argument("--shared", type=Path, default=SHARED, help="folder of the recordings (../shared)")
    parser.add_argument("--out", type=Path, help="JSON with all results")
    args = parser.parse_args()
    if wrong := set(args.sets) - set(SETS):
        parser.error(f"no set {', '.join(sorted(wrong))}; expected {', '.join(SETS)}")
    with tempfile.TemporaryDirectory(prefix="tinygc-") as made:
        units = [unit for name in args.sets or SETS for unit in units_of(name, args.shared, Path(made))]
        units = [unit for unit in units if not args.only or unit.name in args.only]
        results = in_parallel(one_unit, units, "unit")
    if args.out:
        args.out.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    print(page(results))


def units_of(name: str, shared: Path, made: Path) -> Iterator[Unit]:
    """The units of a set with their session folders; none where the set is not there."""
    sources = [source for source in (shared / name, shared / "wild" / name) if source.is_dir()]
    folders = [folder for source in sources for folder in import_module(f"public.{name}").write(source, made / name)]
    if name == "mimu":
        for unit in range(8):
            yield Unit(name, f"u{unit}", tuple(folder for folder in folders if folder.name.endswith(f"u{unit}")))
    elif folders:
        yield Unit(name, name, tuple(folders))


def one_unit(unit: Unit) -> dict:
    """Names of each session with their outcomes in each other one."""
    from tinygc.explanation.checked import check_on, named_in, outcome_of
    from tinygc.library.explanations import explain

    explained, refused = {}, {}
    for folder in unit.folders:
        try:
            explained[folder.name] = explain(folder).explanation
        except CalibrationError as error:
            refused[folder.name] = str(error)
    names = []
    for name, first in explained.items():
        others = {other: check_on(first, second) for other, second in explained.items() if other != name}
        for number, named in enumerate(named_in(first)):
            there = {other: checked.effects[number] for other, checked in others.items()}
            told = {
                other: {"outcome": e.outcome.value, "size": e.size, "odds": e.odds, "closure_rad": e.closure_rad}
                for other, e in there.items()
            }
            names.append({"session": name, "id": named.effect.id, "probability": named.probability, "there": told})
            names[-1]["outcome"] = outcome_of(list(there.values())).value
    return {"set": unit.set_name, "unit": unit.name, "sessions": list(explained), "refused": refused, "names": names}


def page(results: list[dict]) -> str:
    """Counts by set, and a row for each effect of each set."""
    lines = []
    for name in dict.fromkeys(result["set"] for result in results):
        mine = [result for result in results if result["set"] == name]
        stated = [each for result in mine for each in result["names"] if each["probability"] >= CONFIDENT]
        counts = Counter(each["outcome"] for each in stated)
        sessions = sum(len(result["sessions"]) for result in mine)
        listed = ", ".join(f"{count} {outcome}" for outcome, count in counts.most_common())
        lines.append(f"{name}: {len(mine)} units, {sessions} sessions, {len(stated)} names at {CONFIDENT} or more: {listed or 'none'}.")
    lines += ["", "| set | effect | stated | confirmed | not confirmed | contradicted | no power | of one recording |", "| --- " * 8 + "|"]
    for key in dict.fromkeys((result["set"], each["id"]) for result in results for each in result["names"]):
        outcomes = Counter(
            each["outcome"]
            for result in results
            for each in result["names"]
            if (result["set"], each["id"]) == key and each["probability"] >= CONFIDENT
        )
        cells = [str(outcomes[o]) for o in ("confirmed", "not confirmed", "contradicted", "no power", "of one recording")]
        lines.append(f"| {key[0]} | `{key[1]}` | {sum(outcomes.values())} | {' | '.join(cells)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
