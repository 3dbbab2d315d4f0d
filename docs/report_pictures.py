"""Make the README's pictures of reports again: python docs/report_pictures.py [--chromium PATH]

Writes the report of data/session1, and of ../shared/xsens where it is there, and takes the top of each page with a headless Chromium.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
#: all but the swarm, which takes longest and shows further down
METHODS = "raw,raw_bias_removed,least_squares,tinygc,tinygc_denoised"
#: session, picture, height of the window, further flags of the browser
PICTURES = (
    (ROOT / "data" / "session1", "report_session1.png", 1520, ()),
    (ROOT.parent / "shared" / "xsens", "report_xsens.png", 1520, ("--blink-settings=preferredColorScheme=0",)),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--chromium", default=shutil.which("chromium") or shutil.which("google-chrome"), help="(%(default)s)")
    args = parser.parse_args()
    if args.chromium is None:
        sys.exit("no Chromium found; give --chromium PATH")
    with tempfile.TemporaryDirectory() as scratch:
        for session, name, height, flags in PICTURES:
            if not session.is_dir():
                print(f"{session} is not there: {name} stays as it is")
                continue
            report = Path(scratch) / f"{session.name}.html"
            subprocess.run(
                [sys.executable, ROOT / "calibrate.py", "report", session, "--out", report, "--methods", METHODS, "--quiet"], check=True
            )
            picture = Path(__file__).parent / name
            settings = ["--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", f"--window-size=1280,{height}", *flags]
            subprocess.run([args.chromium, *settings, f"--screenshot={picture}", report.as_uri()], check=True, capture_output=True)
            print(f"{picture.relative_to(ROOT)}: {picture.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
