"""Output for users: terminal tables, HTML reports and pictures."""

from __future__ import annotations

from dataclasses import dataclass

from session.base.options import option
from tinygc.estimation.options import Limit


@dataclass(frozen=True)
class ReportOptions(Limit):
    """What a calibration report holds, and where it goes."""

    explain: bool = option(True, "ask why recording and simulation differ", off="do not ask why recording and simulation differ")
    pdf: bool = option(False, "print it as well, to a PDF next to it; needs Chromium")
