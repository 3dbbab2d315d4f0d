"""Recordings of several units on one rigid body: ``fit``, ``explain``, ``apply``, ``check``, ``import`` and ``simulate`` of an array."""

from session.base.features import Feature

FEATURE = Feature(
    public={"array": "library", "Array": "library", "ArraySession": "recording"},
    serves={
        "kind of folder": "points:kind_of_folder",
        "line of a list": "points:listed",
        "options of simulate": "options:ArrayOptions",
        "options of import": "options:ImportOptions",
        "options of apply": "options:ApplyOptions",
        "simulation": "command:simulate",
        "fit of a folder": "command:fit",
        "explanation of a folder": "command:explain",
        "check of a recording": "points:check",
        "use of a model": "points:apply",
        "import of logs": "points:import_logs",
    },
)
