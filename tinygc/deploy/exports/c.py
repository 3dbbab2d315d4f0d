"""C99 for a microcontroller or any other machine: one header, and one source with the weights (docs/firmware.md)."""

from __future__ import annotations

from session import VERSION
from tinygc.deploy.embedded.program import Registers, program
from tinygc.deploy.embedded.source import source_files
from tinygc.deploy.exports._context import Context
from tinygc.models.model import Model

NAME = "c"


def export(model: Model, context: Context) -> dict[str, str]:
    """Export a model.  Raises ExportError for physics that a device cannot correct sample by sample."""
    sensor = context.config.sensor
    chosen = program(model, sensor.odr_hz)
    facts = {
        "session": context.session,
        "method": f"{context.method}, {chosen.parameters} parameters",
        "sensor": f"{sensor.model} {sensor.serial}".rstrip() + f", {sensor.odr_hz:g} Hz",
    }
    if model.made_for_hz:
        facts["denoiser"] = f"made for {model.made_for_hz:g} Hz, {1e3 * model.delay_s:.2f} ms late"
    for name in [*context.hashes][:1]:  # the model's own file
        facts["sha256"] = f"{context.hashes[name]} {name}"
    facts["force"] = context.accelerometer_words.split(";")[0]
    if context.accelerometer_unobserved:
        facts["unseen"] = f"of the accelerometer, not observed: {', '.join(context.accelerometer_unobserved)}"
    if context.effects_of_force:
        facts["missing"] = f"of the accelerometer, not in this format: {', '.join(context.effects_of_force)}"
    registers = Registers.of(context.config, context.accelerometer)
    if registers is None:
        context.remark("no tinygc_from_registers: not all registers are known; give it rad/s and m/s^2")
    return source_files(chosen, registers, f"A gyroscope's calibration, by TinyGC {VERSION}.", facts, context.accelerometer)
