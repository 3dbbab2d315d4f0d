"""What a guided recording tells of itself: to a screen, to lines, to a page."""

from __future__ import annotations

from typing import Protocol as Interface

from session.guide.guide import Guide
from session.guide.messages import Change


class View(Interface):
    """A screen, or lines."""

    def change(self, change: Change) -> None:
        """Something has changed."""

    def show(self, guide: Guide) -> None:
        """Draw the present state."""
