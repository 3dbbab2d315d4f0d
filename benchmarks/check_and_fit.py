"""``check`` and ``fit`` on every real recording beside the checkout: verdicts, exit codes, and what of the turns counts.

    python benchmarks/check_and_fit.py [xsens mikov mimu wild/mimu wild/sundevil euroc] [--only NAME …]

Each recording is a session of one sensor.  A recording on which ``check`` passes and ``fit`` refuses (exit code 2), or the reverse, ends
its row with "apart".
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from common import in_parallel, markdown
from real_recordings import SETS, Job, add_choice, jobs_of

ROOT = Path(__file__).resolve().parents[1]
MORE = ("wild/mimu", "wild/sundevil")
USUAL = (*(name for name in SETS if name != "injected"), *MORE)
HEADER = ("recording", "check", "gyro against gravity", "turns", "fit", "fit's words", "")
#: of a rocket's 9-axis board at 20 Hz: t, specific force in m/s², rates in dps, then what is not read
SUNDEVIL = """schema = "tinygc-session/1"

[sensor]
model = "unknown"
odr_hz = 20.0
gyro_fs_dps = {full_scale_dps:g}
accel_fs_g = 16
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_choice(parser, f"of {', '.join(USUAL)} (all)")
    parser.add_argument("--methods", default="least_squares", help="of fit (%(default)s)")
    args = parser.parse_args()
    if wrong := set(args.sets) - set(USUAL):
        parser.error(f"no set {', '.join(sorted(wrong))}; expected {', '.join(USUAL)}")
    with tempfile.TemporaryDirectory(prefix="tinygc-") as made:
        jobs = [job for name in args.sets or USUAL for job in sessions_of(name, args.shared, Path(made))]
        jobs = [(job, args.methods, Path(made)) for job in jobs if not args.only or job.folder.name in args.only]
        rows = in_parallel(one_recording, jobs, "recording")
    print(markdown(HEADER, rows))


def sessions_of(name: str, shared: Path, made: Path) -> Iterator[Job]:
    """The recordings of a set, session folders made of what is none."""
    if name == "wild/sundevil":
        yield from (Job(name, write_sundevil(path, made / path.stem)) for path in sorted((shared / name).glob("rev2/IMU*.txt")))
    elif name in MORE:
        yield from (Job(name, job.folder) for job in jobs_of("mimu", shared / "wild", made / "wild"))
    else:
        yield from jobs_of(name, shared, made)


def write_sundevil(source: Path, folder: Path, factor: float = 1.0) -> Path:
    """A session folder of one of the board's files, as its authors read it, ±250 dps; or with rates and full scale times a factor."""
    folder.mkdir(parents=True)
    lines = ["t_s,ax_mps2,ay_mps2,az_mps2,gx_dps,gy_dps,gz_dps"]
    for line in source.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.split("\t")[:7]]
        lines.append(",".join([*cells[:4], *(repr(factor * float(cell)) for cell in cells[4:])]))
    (folder / "log0001.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / "session.toml").write_text(SUNDEVIL.format(full_scale_dps=250 * factor), encoding="utf-8")
    return folder


def one_recording(job: tuple[Job, str, Path]) -> tuple[str, ...]:
    """One row of the table."""
    (job, methods, made), name = job, f"{job[0].set_name} {job[0].folder.name}"
    look = made / f"{name.replace('/', '-')}.json"
    checked = _run("check", str(job.folder), "--json", str(look))
    findings = json.loads(look.read_text(encoding="utf-8"))["findings"]

    def says(*what: str) -> str:
        return "; ".join(f"{f['what']} {f['level']}: {_short(f['description'])}" for f in findings if f["what"] in what)

    worst = next((level for level in ("error", "warning") if any(f["level"] == level for f in findings)), "ok")
    fitted = _run("fit", str(job.folder), "--quiet", "--methods", methods, "--out", str(made / name.replace("/", "-")))
    words = next((line for line in [*fitted.stderr.splitlines(), *fitted.stdout.splitlines()] if line.strip()), "")
    apart = (checked.returncode == 2) != (fitted.returncode == 2)
    agrees = says("gyro against gravity", "axes", "gyro scale", "gyro ceiling")
    return (
        name,
        f"{worst}, {checked.returncode}",
        agrees,
        says("turns"),
        str(fitted.returncode),
        _short(words.replace(str(job.folder), ""), 120),
        "apart" * apart,
    )


def _short(text: str, most: int = 160) -> str:
    text = re.sub(r"\s+", " ", text.replace("|", "/"))
    return text if len(text) <= most else text[: most - 1] + "…"


def _run(*arguments: str) -> subprocess.CompletedProcess[str]:
    """A command of this checkout; exit codes 0, 1 and 2 are answers."""
    return subprocess.run([sys.executable, ROOT / "calibrate.py", *arguments], capture_output=True, text=True, check=False)


if __name__ == "__main__":
    main()
