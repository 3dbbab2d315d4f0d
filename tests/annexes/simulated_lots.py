"""Lots of sensors with a known mean, spread, drift and repeatability: sessions as their fits would tell them."""

import numpy as np

from session.io.units import DEG
from tinygc.annexes.lots.lot import NAMES, UnitResult

COUNT = len(NAMES)
#: between units, one sigma of each number, SI
SPREAD = np.array([3e-3] * 9 + [0.6 * DEG] * 3 + [2e-3, 1e-3, 1e-3, 2e-3, 1e-3, 2e-3, 0.1, 0.1, 0.1])


def truth(seed=0):
    """mean (21,) and covariance (21, 21) of a lot."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(COUNT, COUNT))
    C = A @ A.T + 10 * np.eye(COUNT)
    size = np.sqrt(np.diag(C))
    mean = np.where(np.isin(NAMES, ("E_xx", "E_yy", "E_zz")), 1.0, 0.0) + SPREAD * rng.normal(size=COUNT)
    return mean, C / np.outer(size, size) * np.outer(SPREAD, SPREAD)


def simulated_lot(units, seed, sessions=1, noise=0.2, drift=0.0, without_accelerometer=0.0):
    """UnitResults; sizes in spreads.  sessions: of each unit, or of some in turn; drift over the whole lot."""
    mean, covariance = truth()
    rng, results = np.random.default_rng(seed), []
    root = np.linalg.cholesky(covariance)
    for u in range(units):
        unit = mean + drift * SPREAD * (u / max(units - 1, 1) - 0.5) + root @ rng.normal(size=COUNT)
        for s in range(sessions if np.isscalar(sessions) else sessions[u % len(sessions)]):
            B = np.eye(COUNT) + 0.3 * rng.normal(size=(COUNT, COUNT))
            R = B @ B.T
            size = noise * SPREAD * np.exp(0.3 * rng.normal(size=COUNT)) / np.sqrt(np.diag(R))
            R = R * np.outer(size, size)
            values = unit + SPREAD * (0.1 * rng.normal(size=COUNT)) + np.linalg.cholesky(R) @ rng.normal(size=COUNT)
            if rng.random() < without_accelerometer:
                values[12:] = R[12:] = R[:, 12:] = np.nan
            name = f"{u:05d}-{s}"
            results.append(UnitResult(name, f"serial {u:05d}", name, values, R, order=float(len(results))))
    return results


def written_fleet(folder, first_model, drift=0.0):
    """A fleet's table of simulated results, the first of which may be of another model."""
    from tinygc.annexes.lots.fleet_row import DONE, SIGMAS, empty, packed
    from tinygc.annexes.lots.fleet_session import Outcome
    from tinygc.annexes.lots.fleet_table import open_table

    folder.mkdir()
    with open_table(folder) as table:
        for number, result in enumerate(simulated_lot(20, 5, [1, 2], drift=drift)):
            row = empty() | {"status": DONE, "model": "ASM330LHH" if number else first_model, "serial": result.serial}
            row |= {"covariance": packed(result.covariance), "held_out_deg": 0.02, "floor_deg": 0.02}
            row |= dict(zip(NAMES, map(float, result.values), strict=True)) | dict(
                zip(SIGMAS, np.sqrt(np.diag(result.covariance)).tolist(), strict=True)
            )
            table.put_folder(folder / result.session, result.key)
            table.put(Outcome(result.key, row), row, [])
    return folder
