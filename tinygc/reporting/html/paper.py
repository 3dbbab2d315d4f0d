"""The report as PDF: printed by a Chromium that is on this machine."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from session.base.errors import CalibrationError
from session.base.files import open_file
from session.base.results import whole

#: names of a Chromium on the search path
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge", "microsoft-edge")
#: s for a page of some MB, on a busy machine
PATIENCE_S = 120.0


def browser_path() -> str | None:
    """Return the first Chromium on the search path; None without one."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


def require_browser() -> str:
    """Return the path of a Chromium.  Raises CalibrationError without one."""
    if (path := browser_path()) is None:
        known = ", ".join(NAMES[:3])
        raise CalibrationError(f"--pdf needs Chromium, and none is found ({known}); install it, or leave --pdf out")
    return path


def print_pdf(page: Path, out: Path) -> Path:
    """Print an HTML file to a PDF file, which appears when it is whole; returns its path.  Raises CalibrationError where that fails."""
    with tempfile.TemporaryDirectory(prefix="tinygc-") as folder, whole(out) as file:
        made = Path(folder) / "page.pdf"
        command = [require_browser(), "--headless=new", "--disable-gpu", "--no-first-run", "--no-pdf-header-footer"]
        command += ["--no-sandbox"] if getattr(os, "geteuid", lambda: 1)() == 0 else []  # the administrator's Chromium has no sandbox
        command += [f"--user-data-dir={folder}/profile", f"--print-to-pdf={made}", page.resolve().as_uri()]
        try:
            done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=PATIENCE_S, stdin=subprocess.DEVNULL)
        except (OSError, subprocess.TimeoutExpired) as error:
            why = f"no answer in {PATIENCE_S:g} s" if isinstance(error, subprocess.TimeoutExpired) else error.strerror
            raise CalibrationError(f"{out}: {command[0]} did not print it ({why}); print {page} by hand") from None
        if not made.is_file():
            last = next((line for line in reversed(done.stderr.splitlines()) if line.strip()), f"exit code {done.returncode}")
            raise CalibrationError(f"{out}: {command[0]} did not print it ({last.strip()[:120]}); print {page} by hand")
        with open_file(made) as printed:
            shutil.copyfileobj(printed, file)
    return out
