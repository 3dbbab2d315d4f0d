"""How long the noise of a rest takes, and how much memory, beside AllanTools' ``oadev`` of the same readings in the same run.

``python benchmarks/noise_speed.py`` estimates all terms of six channels.  AllanTools computes the overlapping Allan deviation of the six at
octaves: points of a curve, of which nothing is estimated.  Long rests come in pieces, as a log is read; one piece of readings is used again
and again, so that only the estimate is timed.
"""

from __future__ import annotations

import argparse
import resource
import time

import allantools
import numpy as np
from common import markdown

from session.io.samples import Samples
from session.io.units import NS_PER_S
from tinygc.annexes.noise.estimate import estimate_noise
from tinygc.annexes.noise.summary import RestSums

RATE_HZ = 1000.0
#: readings of a piece
PIECE = 1 << 18


def ours_s(count: int, values: np.ndarray) -> tuple[float, float]:
    """Seconds of the sums, and of the estimate."""
    sums, began = RestSums(RATE_HZ), time.perf_counter()
    for start in range(0, count, PIECE):
        part = values[: min(PIECE, count - start)]
        t_ns = ((start + np.arange(len(part))) * (NS_PER_S / RATE_HZ)).astype(np.int64)
        sums.add(Samples(t_ns, part[:, :3], part[:, 3:], None))
    between = time.perf_counter()
    estimate_noise([sums])
    return between - began, time.perf_counter() - between


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--most", type=float, default=1e8, help="samples of the longest rest")
    args = parser.parse_args()
    rng = np.random.default_rng(0)
    values = rng.standard_normal((PIECE, 6)) + 0.01 * np.cumsum(rng.standard_normal((PIECE, 6)), axis=0)
    rows = []
    for count in (10**5, 10**6, 10**7, 10**8):
        if count > args.most:
            continue
        reading, estimating = ours_s(count, values)
        theirs = "-"
        if count <= 10**7:  # beyond it one channel's phase and its differences fill the memory
            began = time.perf_counter()
            for channel in range(6):
                allantools.oadev(np.resize(values[:, channel], count), rate=RATE_HZ, data_type="freq", taus="octave")
            seconds = time.perf_counter() - began
            theirs = f"{seconds:.1f} s, {(reading + estimating) / seconds:.2f}"
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        rows.append([f"{count:.0e}", f"{reading:.1f} s", f"{estimating:.1f} s", theirs, f"{memory:.0f} MB"])
        print(rows[-1], flush=True)
    print(markdown(["samples", "sums", "estimate", "AllanTools, ours over theirs", "largest memory so far"], rows))


if __name__ == "__main__":
    main()
