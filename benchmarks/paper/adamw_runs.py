"""AdamW's trainings on the EuRoC windows, which take minutes each: kept in build/paper, with the CPU seconds that they took.

Tables and figures take them from there; an interrupted one goes on.  Remove the folder to train anew.
"""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from paper.euroc import Euroc
from session.io.results import write_whole
from tinygc.estimation.network import train_adamw
from tinygc.estimation.options import Checkpoint
from tinygc.models.nets import CalibrationNet, PublishedNet

RUNS = Path(__file__).resolve().parents[2] / "build" / "paper"
NETS = {"27": CalibrationNet, "26": PublishedNet}


@dataclass(frozen=True, eq=False)
class Run:
    """net at the end; loss before each epoch; CPU seconds, one thread."""

    net: CalibrationNet | PublishedNet
    loss: np.ndarray
    seconds: float


def adamw_run(euroc: Euroc, net: str = "27", loss: str = "squared", epochs: int = 2000) -> Run:
    """One training from the identity, with the tree product; net "27" or "26", the published one; loss "squared" or "distance"."""
    import torch

    torch.set_num_threads(1)
    RUNS.mkdir(parents=True, exist_ok=True)
    clock = RUNS / f"{net}_{loss}_{epochs}.seconds.json"
    checkpoint = Checkpoint(RUNS / f"{net}_{loss}_{epochs}.json", resume=True)
    spent = json.loads(clock.read_text()) if clock.exists() and checkpoint.path.exists() else 0.0
    began, batch = time.process_time(), euroc.training.batch

    def keep_time(epoch: int, of: int) -> None:
        if epoch % 20 == 0 or epoch == of:
            write_whole(clock, spent + time.process_time() - began)

    trained = train_adamw(
        batch, euroc.training.floor.sigma, epochs=epochs, loss=loss, start=NETS[net].identity(), checkpoint=checkpoint, progress=keep_time
    )
    return Run(trained.net, np.array(trained.loss), float(json.loads(clock.read_text())))


def main() -> None:
    """All that tables and figures ask for."""
    from paper.euroc import euroc_folders, read_euroc

    with euroc_folders() as parent:
        euroc = read_euroc(parent)
        for net, loss in (("27", "distance"), ("27", "squared"), ("26", "distance"), ("26", "squared")):
            run = adamw_run(euroc, net, loss)
            errors = euroc.errors_deg(run.net)
            print(
                net,
                loss,
                f"{run.seconds:.0f} s, loss {run.loss[-1]:.6g}, AOE",
                *np.round(errors, 2),
                f"mean {errors.mean():.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
