"""A simulated rest log: temperature up and down, a zero that follows it late and not quite the same way back, noise of every colour.

Its lag is integrated sample by sample with the sample's own step, and its hysteresis is a play: code of its own, that no estimator shares.
"""

from __future__ import annotations

import gzip
import json
from dataclasses import asdict, dataclass, field, fields
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import lfilter

from session.common.errors import CalibrationError
from session.common.units import DEG, DEG_PER_HOUR, G
from session.common.version import SCHEMA  # type: ignore[attr-defined] # noqa: F401
