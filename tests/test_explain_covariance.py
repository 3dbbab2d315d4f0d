"""The covariance of an explanation's residuals: whitened noise is white."""

import numpy as np
from small_sessions import small_session

from tinygc.noise.components import known_whitener
from tinygc.noise.twin import Twin


def test_whitening_some_rows_is_whitening_of_their_own_covariance():
    whiten = known_whitener(Twin(small_session()))
    n = whiten.parts["length"].stop
    backward = whiten(np.eye(n))
    covariance = np.linalg.inv(backward.T @ backward)
    rows = np.random.default_rng(1).random(n) < 0.7
    part = whiten.only(rows)
    forward = part(np.eye(n))
    assert forward.shape == (rows.sum(), n)
    assert not forward[:, ~rows].any()
    np.testing.assert_allclose(forward @ covariance @ forward.T, np.eye(rows.sum()), atol=1e-6)
    np.testing.assert_allclose(whiten.only(np.ones(n, dtype=bool))(np.eye(n)), backward, rtol=1e-9)
    np.testing.assert_allclose(part.sigma, np.sqrt(np.diag(covariance))[rows], rtol=1e-6)
