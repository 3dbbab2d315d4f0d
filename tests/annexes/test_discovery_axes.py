"""A constant that differs by axis: seen where one for all makes another law of it, and not seen where there is one."""

from types import SimpleNamespace

import numpy as np
import pytest
from simulated_twins import make_twin_of

from session.io.units import DEG
from tinygc.annexes.discovery.constants import by_axis
from tinygc.annexes.discovery.form import Factor, LawForm
from tinygc.annexes.discovery.projections import Projection
from tinygc.annexes.discovery.responses import Responses
from tinygc.annexes.discovery.selection import FormEvidence
from tinygc.annexes.discovery.words import constant_of
from tinygc.explanation.search import rewhitened
from tinygc.noise.refit import Replay

twin_of = pytest.fixture(make_twin_of, scope="module", name="twin_of")
FS_DPS = 500.0


def held_back(widths_dps):
    """Each axis shows a tenth less of its rate within a width of its own."""
    widths = np.array(widths_dps) * DEG

    def distort(t_s, rate, force, temp_c):
        return rate - 0.1 * np.clip(rate, -widths, widths)

    return distort


def searched_with(twin, width_dps):
    """As much of a search as the question needs: one law beside nothing else."""
    evidence = FormEvidence(twin)
    form = LawForm((Factor("rate", "within", width_dps / FS_DPS),))
    law = evidence.effect_of(form)
    best = evidence.of((law,), evidence.nothing)
    whiten = best.whiten
    screening = SimpleNamespace(all_responses=Responses(Replay(twin, evidence.nothing.fit)))
    projection = Projection(twin, whiten, rewhitened(evidence.of((), best), whiten))
    searched = SimpleNamespace(
        evidence=evidence, round_of=lambda _: SimpleNamespace(screening=screening), projection_without=lambda _: projection
    )
    return searched, law, form, screening.all_responses, projection


def test_a_constant_of_what_has_no_axis_has_no_axes(twin_of):
    _, _, _, responses, projection = searched_with(twin_of(None)[0], 8.0)
    assert by_axis(LawForm((Factor("time", "decay", 50.0),)), responses, projection) == []


def test_a_constant_is_told_in_a_persons_unit():
    form = LawForm((Factor("turned", "play", 0.1), Factor("rate", "dead_zone", 0.02, 1.5)))
    assert [constant_of(form, number)[0] for number in range(3)] == ["play (°)", "width (of full scale)", "lag (s)"]
    assert constant_of(form, 0)[1] == pytest.approx(180 / np.pi)
