"""Whether what ``explain --discover`` writes is used as any effect is: from a session that hides a law, to its file, to every command.

    python benchmarks/discovered_files.py [--only rate_product …] [--json FILE]

Each law of ``LAWS``, which no catalogue has, is hidden in two simulated sessions at its strong size: the first is searched, the second
turns otherwise, more briskly, with another unit, and has the same law with the same numbers.  The file that was written for the first
stays as it is.  It must pass the proof of an effect (``tinygc.effects.testing.check``); ``explain --effects`` must name it in the second;
and there it must serve ``fit --physics auto``, ``apply``, ``export`` and ``simulate``.  Closure is of held-out segments, rms, before and
after, as ``explain`` says it of each session, and as ``fit`` says it of least squares and of physics.  A law without C has its reason.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path

from common import markdown, progress

import calibrate
from tinygc.annexes.challenge.cases import Case, conceal
from tinygc.annexes.challenge.law_examination import ALL
from tinygc.effects import load_folder, using
from tinygc.effects.device import NoC
from tinygc.effects.testing import check
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.write import write_files

#: of ``tinygc.challenge.discover.laws`` -> degC by which its sessions warm up
LAWS = {
    "rate_product": 1.5,
    "rate_squares": 1.5,
    "cross_cube": 1.5,
    "drive_droop": 1.5,
    "root_scale": 1.5,
    "force_scale": 1.5,
    "anisoelastic": 1.5,
    "rectified_acceleration": 1.5,
    "last_turn": 1.5,
    "overload": 1.5,
    "turn_hysteresis": 1.5,
    "warm_square": 10.0,
}
#: seeds of what is hidden, and of the two sessions; how vigorously they are turned
HIDDEN_SEED, SEEDS, VIGOUR = 7, (21, 22), (1.0, 1.4)
SEGMENTS, ODR_HZ = 36, 104.0


@dataclass
class Chain:
    """What came of one law.  ids of effects; failed: parts of the proof; closure, deg, before and after; went: of each command, "" or why
    it did not serve; c: "yes" or why there is none."""

    law: str
    verdict: str = ""
    ids: list[str] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)
    first_deg: tuple[float, float] | None = None
    named: list[str] = field(default_factory=list)
    second_deg: tuple[float, float] | None = None
    fit_deg: tuple[float, float] | None = None
    went: dict[str, str] = field(default_factory=dict)
    c: str = ""
    seconds: float = 0.0

    @property
    def whole(self) -> bool:
        """Whether everything holds."""
        served = bool(self.went) and not any(self.went.values())
        return bool(self.ids) and not self.failed and set(self.ids) <= set(self.named) and served


def command(*words: object) -> tuple[int, str]:
    """Exit code of ``calibrate.py``, and the last line that it says of an error."""
    said = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said):
        try:
            code = calibrate.main([str(word) for word in words])
        except SystemExit as left:
            code = int(left.code or 0)
    return code, (said.getvalue().strip().splitlines() or [""])[-1]


def sessions(law: str, folder: Path) -> tuple[Path, Path]:
    """The two, with the same law."""
    for name, seed, vigour in zip(("first", "second"), SEEDS, VIGOUR, strict=True):
        options = SimulationOptions(
            segments=SEGMENTS, closure_s=0.0, odr_hz=ODR_HZ, seed=seed, vigour=vigour, warm_up_c=LAWS[law], latitude_deg=31.0
        )
        simulation, config, _ = conceal(Case(name, (f"law.{law}",), (1.0,), options, HIDDEN_SEED, "stated"), ALL)
        write_files(simulation, folder / name, config)
    return folder / "first", folder / "second"


def chained(law: str, folder: Path, say: Callable[[str], None]) -> Chain:
    """One law, from its session to every command."""
    found = Chain(law)
    first, second = sessions(law, folder)
    say("discover")
    command("explain", first, "--discover", "--no-pictures")
    table = json.loads((first / "explain" / "explain.json").read_text(encoding="utf-8"))
    laws = table["discovery"]["laws"]
    found.verdict, found.ids = table["discovery"]["verdict"], [each["id"] for each in laws]
    if not laws:
        return found
    held_out = laws[0]["held_out"][0]
    found.first_deg = (held_out["before_deg"], held_out["after_deg"])
    effects = first / "explain" / "effects"
    say("proof")
    with using([]):
        loaded = {effect.id: effect for effect in load_folder(effects)}
        found.failed = [part for each in found.ids for part in check(loaded[each]).failed]
    found.c = next((effect.device.why for effect in loaded.values() if isinstance(effect.device, NoC)), "yes")
    say("the second session")
    found.went = served(laws, loaded, effects, second, found.c == "yes")
    told = json.loads((second / "explain" / "explain.json").read_text(encoding="utf-8"))
    found.named = [each["id"] for each in told["effects"]]
    proof = told["fit"]["holdout_closure_rms_deg"]
    found.second_deg = (proof["before"], proof["after"])
    if not found.went["fit"]:
        methods = json.loads((second / "fit" / "fit.json").read_text(encoding="utf-8"))["methods"]
        linear, physics = (methods[name]["holdout"]["tilt_rms_deg"] for name in ("least_squares", "physics"))
        found.fit_deg = (linear, physics)
    return found


def served(laws: list[dict], loaded: dict, effects: Path, second: Path, has_c: bool) -> dict[str, str]:
    """Command -> "" where it does what it is asked for, or why not."""
    hidden = []
    for law in laws:
        scan, told = loaded[law["id"]].scan, dict(law["parameters"])
        told |= {name: each["value"] for name, each in law["constants"].items() if scan is not None and scan.name == name}
        hidden += ["--effect", f"{law['id']}={json.dumps(told)}"]
    (log,) = second.glob("log*")
    model, simulated, calibrated = second / "fit" / "model_physics.json", second.parent / "simulated", second.parent / "calibrated.csv"
    use = ("--effects", effects)
    words = {
        "explain": ("explain", second, "--no-pictures", *use),
        "fit": ("fit", second, "--physics", "auto", "--methods", "least_squares", *use),
        "apply": ("apply", model, log, "-o", calibrated, *use),
        "json": ("export", second, "--to", "json", "--model", "physics", *use),
        "c": ("export", second, "--to", "c", "--model", "physics", *use),
        "simulate": ("simulate", "--out", simulated, "--segments", 6, "--closure", 0, "--seed", 3, *use, *hidden),
    }
    went = {}
    for name, each in words.items():
        code, said = command(*each)
        went[name] = "" if code == 0 or (name == "c" and not has_c and "cannot be exported to C" in said) else said or f"exit code {code}"
    if not went["fit"]:
        missing = [law["id"] for law in laws if law["id"] not in model.read_text(encoding="utf-8")]
        went["fit"] = f"its model is without {', '.join(missing)}" if missing else ""
    return went


def row(chain: Chain) -> tuple:
    """Of the table."""
    if not chain.ids:
        return chain.law, f"({chain.verdict})", *("",) * 7
    named = "yes" if set(chain.ids) <= set(chain.named) else ", ".join(chain.named) or "nothing"
    failed = "; ".join(f"{name}: {why}" for name, why in chain.went.items() if why)
    return (
        chain.law,
        ", ".join(name.removeprefix("discovered.") for name in chain.ids) + ("" if chain.verdict == "found" else f" ({chain.verdict})"),
        _ratio(chain.first_deg),
        ", ".join(chain.failed) or "yes",
        named,
        _ratio(chain.second_deg),
        _ratio(chain.fit_deg),
        failed or "all",
        chain.c,
    )


def _ratio(pair: tuple[float, float] | None) -> str:
    return "" if pair is None else f"{pair[0]:.3f} → {pair[1]:.4f}, {pair[0] / pair[1]:.0f}"


HEADER = ("law", "found as", "searched, °, ratio", "proof", "named in another", "there, °, ratio", "fit there, °, ratio", "commands", "C")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=tuple(LAWS), default=list(LAWS), metavar="LAW", help="one of, or several")
    parser.add_argument("--json", type=Path, help="write what came of every law")
    args = parser.parse_args()
    chains = []
    for number, law in enumerate(args.only, 1):
        begun = time.process_time()
        with tempfile.TemporaryDirectory(prefix="tinygc-") as folder:
            chains.append(chained(law, Path(folder), lambda step: progress(f"{law}, {number} of {len(args.only)}: {step}")))  # noqa: B023
        chains[-1].seconds = time.process_time() - begun
    progress("")
    if args.json:
        args.json.write_text(json.dumps([asdict(each) for each in chains], indent=1))
    print(markdown(HEADER, map(row, chains)))
    proved = [each for each in chains if each.ids and not each.failed]
    found = [each for each in chains if each.ids]
    named = [each for each in found if set(each.ids) <= set(each.named)]
    print(
        f"\n{len(found)} of {len(chains)} laws have a file; {len(proved)} of them pass the proof, {len(named)} are named in the second "
        f"session, {sum(each.whole for each in chains)} serve every command; {sum(each.seconds for each in chains):.0f} CPU s"
    )


if __name__ == "__main__":
    main()
