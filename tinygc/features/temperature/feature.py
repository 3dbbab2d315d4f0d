"""A model over temperature, of rest logs and of sessions at several temperatures."""

from session.base.features import Feature

FEATURE = Feature(
    public={"fit_temperature": "library", "ThermalFit": "library"},
    kinds={"thermal": "model"},
    exports={"thermal": "deploy"},
    serves={
        "options of fit": "command:add_fit_arguments",
        "fit of folders": "command:fit",
        "options of simulate": "command:add_simulate_arguments",
        "simulation": "command:simulate",
    },
)
