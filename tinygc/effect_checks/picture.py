"""A picture is drawn, and it shows something."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tinygc.effect_checks.report import NotChecked, Wrong
from tinygc.effects import Effect
from tinygc.explanation.pictures.panels import draw_claim
from tinygc.explanation.verdict.explain import Explanation

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.backends.backend_agg import FigureCanvasAgg

#: of a panel's pixels that must be ink, beyond those of its empty frame
INK = 0.002


def picture(effect: Effect, e: Explanation | None) -> str:
    """Both panels hold data, and ink, with their axes labelled."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        raise NotChecked("no matplotlib on this machine") from None
    if e is None:
        raise NotChecked("no explanation shows it: give one with explanation=")
    claim = next((claim for claim in [*e.claimed, *e.findings] if claim.effect.id == effect.id), None)
    if claim is None:
        raise Wrong(f"the explanation that was given claims no {effect.id}")
    figure = Figure(figsize=(13, 4), layout="constrained")
    canvas = FigureCanvasAgg(figure)
    panels = figure.subplots(1, 2)
    draw_claim(e, claim, *panels)
    shares = []
    for name, panel in zip(("left", "right"), panels, strict=True):
        if not panel.has_data():
            raise Wrong(f"the {name} panel is empty")
        if not (panel.get_xlabel() and panel.get_ylabel()):
            raise Wrong(f"the {name} panel has an axis without a label")
        shares.append(_ink(canvas, panel))
        if shares[-1] < INK:
            raise Wrong(f"the {name} panel shows nothing: {100 * shares[-1]:.2g} % of it is ink")
    return f"both panels drawn, {100 * min(shares):.1f} % ink"


def _ink(canvas: FigureCanvasAgg, panel: Axes) -> float:
    """Share of the panel's inner pixels that are not white."""
    canvas.draw()
    image = np.asarray(canvas.buffer_rgba())[..., :3]
    box = panel.get_window_extent()
    height = len(image)
    inner = image[height - int(box.y1) + 3 : height - int(box.y0) - 3, int(box.x0) + 3 : int(box.x1) - 3]
    return float((inner < 250).any(axis=-1).mean())
