"""A truth file's clock and mounting: what real recordings show whose clocks their authors have aligned (../shared/euroc)."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from common import markdown
from public.euroc import write_sequences

from session.base.units import DEG
from session.log.folder import read_session
from tinygc.features.truth.alignment import align

EUROC = Path(__file__).resolve().parents[2] / "shared" / "euroc"
SEQUENCES = ("MH_02", "MH_03", "MH_04", "MH_05", "V1_01", "V1_02", "V1_03", "V2_01", "V2_02", "V2_03")


def main() -> None:
    argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0]).parse_args()
    print(markdown(("EuRoC", "offset, ms", "sigmas", "gyro to truth, °", "read as"), [_real(name) for name in SEQUENCES]))


def _real(name: str) -> tuple[str, ...]:
    with tempfile.TemporaryDirectory() as folder:
        alignment = align(read_session(write_sequences(EUROC, [name], Path(folder) / name, segment_s=2.0))).reference.alignment
    assert alignment is not None
    shown = f"{1e3 * alignment.offset_s:+.3f} ± {1e3 * alignment.offset_sigma_s:.3f}"
    turned = ", ".join(f"{t:.2f} ± {s:.2f}" for t, s in zip(alignment.turned / DEG, alignment.turned_sigma / DEG, strict=True))
    reading = alignment.reading
    return (
        name,
        shown,
        f"{abs(alignment.offset_s) / alignment.offset_sigma_s:.1f}",
        turned,
        f"{reading.frame}, {reading.sense}, {reading.order}",
    )


if __name__ == "__main__":
    main()
