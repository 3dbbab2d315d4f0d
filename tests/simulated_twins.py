"""Twins of simulated sessions, for the tests of an explanation's parts."""

from tinygc import SimulationOptions, read_session
from tinygc.closure.build import build_problem
from tinygc.noise.components import known_whitener
from tinygc.noise.twin import Twin
from tinygc.simulation.write import write_session


def make_twin_of(tmp_path_factory):
    """``twin_of(distort, segments=12, …)``: a simulated session, ready to be replayed, with its whitener."""
    made = {}

    def make(distort=None, **options):
        chosen = SimulationOptions(**{"segments": 12, "closure_s": 0.0, "seed": 3, "odr_hz": 104.0, **options})
        if (distort, chosen) not in made:
            folder = write_session(chosen, tmp_path_factory.mktemp("twin") / "session", distort=distort)
            twin = Twin(build_problem(read_session(folder)))
            made[distort, chosen] = twin, known_whitener(twin)
        return made[distort, chosen]

    return make
