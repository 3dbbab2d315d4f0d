"""The exported C on an emulated Cortex-M4F: sizes, instructions a sample, and how far it is from NumPy, PyTorch and double precision.

QEMU counts instructions, not cycles: a load or a taken branch takes two or more.  Needs the tools of
docs/firmware.md.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import tempfile
from pathlib import Path

import numpy as np
import torch

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "firmware"))

from common import markdown, progress
from emulator import build as kit

from session.base.errors import CalibrationError
from session.base.units import DEG
from session.log.folder import Session, read_session
from tinygc import models
from tinygc.deploy.embedded.program import Inputs, Program, Registers, program
from tinygc.deploy.embedded.source import source_files
from tinygc.estimation.options import FitOptions
from tinygc.fitting.fit import fit_session
from tinygc.fitting.fit_file import save_models
from tinygc.models.denoiser import DenoisedNet

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
        costs, distances = [], []
        for method, model in chosen.items():
            progress(method)
            rows, distance = _measure(method, model, session, folder / method, args.samples)
            costs += rows
            distances.append(distance)
    progress("")
    head = ["model", "parameters", "flags", "code, bytes", "weights", "state", "self-test", "instructions", f"of 168 MHz at {ODR_HZ} Hz"]
    print(markdown(head, costs))
    print()
    against = [
        "NumPy, bits",
        "PyTorch, random",
        "PyTorch, turns to 250 dps",
        "PyTorch, to 500 dps",
        "double, random",
        "double, to 500 dps",
        "PyTorch from double",
    ]
    against.append("self-test")
    print(markdown(["model", *against], distances))


def _fitted(session: Path, folder: Path) -> list[Path]:
    progress("fitting")
    save_models(fit_session(session, FitOptions(methods=METHODS, folds=2)), folder)
    return [folder / f"model_{method}.json" for method in METHODS]


def _measure(method: str, model, session: Session, folder: Path, samples: int) -> tuple[list[list[str]], list[str]]:
    """Rows of the first table, and the row of the second."""
    chosen = program(model)
    sensor = Registers.of(session.config) or Registers()
    folder.mkdir()
    for name, text in source_files(chosen, sensor, "A benchmark.", {}).items():
        (folder / name).write_text(text)
    inputs = _random(sensor, samples)
    expected = chosen.run(Inputs.of(inputs[:, :3], inputs[:, 3:6], inputs[:, 6]))
    rows, differ, said = [], 0, []
    for flags in ("-Os", "-O2", "-O2 -ffp-contract=fast"):
        build = folder / flags.replace(" ", "")
        found = kit.run(kit.build("kit.elf", folder, build, flags), inputs, folder)
        size = kit.sizes(build)
        share = found.instructions * ODR_HZ / CORE_HZ
        numbers = [size.code, size.weights, size.state, size.self_test, round(found.instructions)]
        rows.append([method, str(chosen.parameters), f"`{flags}`", *map(str, numbers), f"{100 * share:.2f} %"])
        if "fast" not in flags:
            differ += np.count_nonzero(found.rates.view(np.uint32) != expected.view(np.uint32))
        verdict = f"failed at {found.self_test}" if found.self_test else "exact" if found.exact else "passed"
        said.append(verdict)
    rate = inputs[:, :3]
    torch_off = [_pytorch(model, chosen, samples) for samples in (rate, _turning(250), _turning(500))]
    fast = _turning(500)
    from_double = [_from_double(model, chosen.run(Inputs.of(rates)), rates) for rates in (rate, fast)]
    from_double.append(_from_double(model, _in_pytorch(model, fast), fast))
    return rows, [method, f"{differ} of {expected.size}", *torch_off, *from_double, ", ".join(said)]


def _random(registers: Registers, samples: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    top = registers.sensor.gyro_fs_dps * DEG
    rate = rng.uniform(-top, top, (samples, 3))
    return np.column_stack([rate, 9.8 * rng.normal(size=(samples, 3)), rng.uniform(10, 40, samples)]).astype(np.float32)


def _turning(top_dps: float) -> np.ndarray:
    """A hand's movement (N, 3) rad/s, with the sensor's noise."""
    rng, t_s = np.random.default_rng(1), np.arange(10_000) / 208
    rate = top_dps * DEG * np.sin(2 * np.pi * np.outer(t_s, [0.2, 0.3, 0.15])) + 1e-3 * rng.normal(size=(len(t_s), 3))
    return rate.astype(np.float32)


def _pytorch(model, chosen: Program, rate: np.ndarray) -> str:
    """Largest difference in rad/s from the model in PyTorch, float32."""
    theirs = _in_pytorch(model, rate)
    return "–" if theirs is None else f"{np.abs(theirs - chosen.run(Inputs.of(rate))).max():.1e}"


def _in_pytorch(model, rate: np.ndarray) -> np.ndarray | None:
    """Rates (N, 3) by PyTorch in float32; None for physics, which is not in PyTorch."""
    if not model.rates_only:
        return None
    return _single(model)(torch.tensor(rate)).numpy()


def _from_double(model, rates: np.ndarray | None, measured: np.ndarray) -> str:
    """Largest difference in rad/s of rates from the model in float64."""
    return "–" if rates is None or not model.rates_only else f"{np.abs(model(measured.astype(float)) - rates).max():.1e}"


def _single(model):
    """The same model in PyTorch, float32."""
    if isinstance(model, DenoisedNet):
        return dataclasses.replace(model, calibration=_single(model.calibration), denoiser=_single(model.denoiser))
    values = {field.name: getattr(model, field.name) for field in dataclasses.fields(model)}
    tensors = {name: torch.tensor(np.asarray(value), dtype=torch.float32) for name, value in values.items()}
    return dataclasses.replace(model, **tensors)


if __name__ == "__main__":
    try:
        main()
    except CalibrationError as error:
        sys.exit(f"firmware: {error}")
