"""The exported C on an emulated Cortex-M4F: sizes, instructions a sample, and how far it is from NumPy, bit by bit, and from PyTorch.

QEMU counts instructions, not cycles: a load or a taken branch takes two or more.  Needs the tools of
docs/firmware.md.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np
import torch

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "firmware"))

from common import markdown, progress
from emulator import build as kit
from paper.as_in_paper import calibrated, denoised

from session.base.errors import CalibrationError
from session.base.units import DEG
from session.log.folder import Session, read_session
from tinygc import models
from tinygc.deploy.embedded.program import Inputs, Program, Registers, program
from tinygc.deploy.embedded.source import source_files
from tinygc.estimation.options import FitOptions
from tinygc.fitting.fit import fit_session
from tinygc.fitting.fit_file import save_models
from tinygc.models.denoiser import REACH, DenoisedNet
from tinygc.models.linear import LinearModel

CORE_HZ, ODR_HZ = 168e6, 833
METHODS = ("least_squares", "tinygc", "tinygc_denoised")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("session", type=Path, nargs="?", default=Path("data/session1"), help="session folder (%(default)s)")
    parser.add_argument("--model", type=Path, help="a model file instead of those that a fit of the session gives")
    parser.add_argument("--samples", type=int, default=10_000, help="random samples for the comparison (%(default)s)")
    args = parser.parse_args()
    if missing := kit.tools_missing():
        sys.exit(f"firmware: {missing}")
    session = read_session(args.session)
    with tempfile.TemporaryDirectory(prefix="tinygc-") as name:
        folder = Path(name)
        files = [args.model] if args.model else _fitted(args.session, folder)
        chosen = {path.stem.removeprefix("model_"): models.load(path) for path in files}
        rows = []
        for method, model in chosen.items():
            progress(method)
            rows.append(_measure(method, model, session, folder / method, args.samples))
    progress("")
    head = ["model", "parameters", "code", "weights", "state", "instructions", "share", "unlike NumPy", "off PyTorch, rad/s"]
    print(markdown(head, rows))


def _fitted(session: Path, folder: Path) -> list[Path]:
    progress("fitting")
    save_models(fit_session(session, FitOptions(methods=METHODS, folds=2)), folder)
    return [folder / f"model_{method}.json" for method in METHODS]


def _measure(method: str, model, session: Session, folder: Path, samples: int) -> list[str]:
    """The row of a model: bytes, instructions a sample, their share of the core at the data rate, and what differs from Python."""
    chosen = program(model)
    sensor = Registers.of(session.config) or Registers()
    folder.mkdir()
    for name, text in source_files(chosen, sensor, "A benchmark.", {}).items():
        (folder / name).write_text(text)
    inputs = _random(sensor, samples)
    expected = chosen.run(Inputs.of(inputs[:, :3], inputs[:, 3:6], inputs[:, 6]))
    found = kit.run(kit.build("measure.elf", folder, folder / "-Os", "-Os"), inputs, folder)
    size = kit.sizes(folder / "-Os")
    differ = np.count_nonzero(found.rates.view(np.uint32) != expected.view(np.uint32))
    numbers = [chosen.parameters, size.code, size.weights, size.state, round(found.instructions)]
    share = f"{100 * found.instructions * ODR_HZ / CORE_HZ:.2f}%"
    return [method, *map(str, numbers), share, f"{differ} of {expected.size}", _pytorch(model, chosen, inputs[:, :3])]


def _random(registers: Registers, samples: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    top = registers.sensor.gyro_fs_dps * DEG
    rate = rng.uniform(-top, top, (samples, 3))
    return np.column_stack([rate, 9.8 * rng.normal(size=(samples, 3)), rng.uniform(10, 40, samples)]).astype(np.float32)


def _pytorch(model, chosen: Program, rate: np.ndarray) -> str:
    """What all differences in rad/s from the model in PyTorch, float32, are below: 1, 2 or 5 of a decimal; physics is not in PyTorch."""
    if not model.rates_only:
        return "–"
    largest = np.abs(_in_pytorch(model, rate) - chosen.run(Inputs.of(rate))).max()
    return f"< {next(step * 10.0**power for power in range(-9, 0) for step in (1, 2, 5) if step * 10.0**power > largest):.6f}"


def _in_pytorch(model, rate: np.ndarray) -> np.ndarray:
    x = torch.tensor(rate, dtype=torch.float32)
    if isinstance(model, DenoisedNet):
        x = torch.tensor(_in_pytorch(model.calibration, rate))
        return denoised(_single(model.denoiser.vector), torch.cat([x[:1].expand(REACH, 3), x])[None])[0].numpy()
    if isinstance(model, LinearModel):
        return (x @ _single(model.E).T + _single(model.B)).numpy()
    return calibrated(_single(model.vector), x).numpy()


def _single(values: np.ndarray) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float32)


if __name__ == "__main__":
    try:
        main()
    except CalibrationError as error:
        sys.exit(f"firmware: {error}")
