"""What two effects here share: a helper is no effect, since its name begins with an underscore."""

import numpy as np


def decay(dt_s: float, seconds: float) -> float:
    """What is left after a sample."""
    return float(np.exp(-dt_s / seconds))
