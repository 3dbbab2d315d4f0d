"""The methods by name, in the order of the report.  Adding a method is adding a line here, and the module that it names.

Nothing heavy is imported before a method runs: the command line takes its names from here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

#: told how many steps of how many are done
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Method:
    """One way from a problem to a model.

    name: in the JSON and on the command line; title: in tables; module: whose ``run(problem, options, progress, before)`` gives the
    ``MethodFit``, ``before`` being what was fitted already, by name; None for what ``tinygc/fitting/physics`` fits, above the methods;
    parameters: how many it fits, None for as many as its model has; chosen: whether ``--methods`` may name it (the others come with an
    option of their own); trained: whether AdamW can train it.
    """

    name: str
    title: str
    module: str | None = None
    parameters: int | None = None
    chosen: bool = True
    trained: bool = False


METHODS = {
    method.name: method
    for method in (
        Method("raw", "raw", "tinygc.methods.raw", parameters=0),
        Method("raw_bias_removed", "raw, first still's bias off", "tinygc.methods.raw_bias_removed", parameters=3),
        Method("least_squares", "least squares", "tinygc.methods.least_squares"),
        Method("pso", "PSO", "tinygc.methods.particle_swarm"),
        Method("tinygc", "TinyGC-Net", "tinygc.methods.network.calibration", trained=True),
        Method("tinygc_denoised", "TinyGC-Net, denoised", "tinygc.methods.denoising.run", trained=True),
        Method("tinygc_conditions", "TinyGC-Net with conditions", "tinygc.methods.network.conditions", chosen=False),
        Method("physics", "linear model with physics", chosen=False),
        Method("tinygc_physics", "TinyGC-Net with physics", chosen=False),
    )
}
#: what ``--methods`` may name, and does by default
CHOSEN = tuple(method.name for method in METHODS.values() if method.chosen)
