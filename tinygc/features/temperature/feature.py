"""A model over temperature, of rest logs and of sessions at several temperatures."""

from session.base.features import Feature

FEATURE = Feature(
    commands={"temperature": "command"},
    public={"fit_temperature": "library", "ThermalFit": "library"},
    kinds={"thermal": "model"},
    exports={"thermal": "deploy"},
    serves={
        "zero over temperature": "points",
        "fit of a folder": "command:fit",
        "options of simulate": "options:RestOptions",
        "simulation": "command:simulate",
    },
)
