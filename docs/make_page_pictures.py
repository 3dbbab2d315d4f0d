"""Make the pictures of the page beside a recording again: python docs/make_page_pictures.py

A hand turns a simulated board as the coach asks; the page is photographed in a headless Chromium at two moments.  Needs Chromium and
matplotlib's Pillow.
"""

from __future__ import annotations

import argparse
import base64
import io
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from browser import Browser, browser_path  # noqa: E402
from coached_hand import CoachedHand  # noqa: E402
from PIL import Image  # noqa: E402

from session.bench.page.server import PageServer  # noqa: E402

COLOURS = 128
#: name, turns before it, CSS px, whether dark
PICTURES = (("view-3-turning", 7, (1280, 900), False), ("view-narrow", 12, (390, 844), True))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    parser.add_argument("--only", default="", help="pictures whose names hold this")
    args = parser.parse_args()
    path = browser_path()
    if path is None:
        sys.exit("no Chromium here")
    with tempfile.TemporaryDirectory() as profile, Browser(path, Path(profile)) as browser:
        moments(browser, args)


def moments(browser: Browser, args: argparse.Namespace) -> None:
    """The page."""
    server = PageServer()
    server.start()
    hand = CoachedHand(server)
    hand.guide.stop_at_target = True
    try:
        for name, accepted, size, dark in PICTURES:
            if args.only in name:
                hand.until(lambda guide, before=accepted - 3: guide.accepted >= before)
                browser.open(server.address, *size, dark=dark, still=True)
                hand.until(lambda guide, turns=accepted: turning(guide.accepted >= turns and guide.turning and guide.turn.path_rad > 0.7))
                shoot(browser, server, args.out / f"{name}.png", size)
    finally:
        server.close()


def turning(there: bool) -> bool:
    """Whether the moment is there; slowly enough for the page to draw each pose of the last ten seconds."""
    time.sleep(0.004)
    return there


def shoot(browser: Browser, server: PageServer, path: Path, size: tuple[int, int]) -> None:
    """As it is now, the ghost at its end (reduced motion)."""
    browser.ask("Runtime.evaluate", {"expression": "new Promise(r => setTimeout(r, 900))", "awaitPromise": True})
    for complaint in browser.complaints():
        if not complaint.startswith(f"fetched {server.address}"):
            print(f"{path.stem}: {complaint}")
    keep(browser, path, size)


def keep(browser: Browser, path: Path, size: tuple[int, int]) -> None:
    """With few colours: flat areas need no more."""
    clip = {"x": 0, "y": 0, "width": size[0], "height": size[1], "scale": 1}
    data = base64.b64decode(browser.ask("Page.captureScreenshot", {"clip": clip})["data"])
    Image.open(io.BytesIO(data)).convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)
    print(f"{path}: {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
