"""The parts of a report, a file each, in their order.  Each is ``section(evidence)`` and gives a ``Section``, or None where the session
has nothing to show for it."""

from tinygc.annexes.discovery import report_section
from tinygc.reporting.html.sections import (
    accelerometer,
    answer,
    application,
    attitudes_over_run,
    closure_per_segment,
    correlations,
    denoising,
    explanation,
    explanation_by_truth,
    methods,
    noise,
    parameters,
    provenance,
    recording,
)

SECTIONS = tuple(
    module.section
    for module in (
        answer,
        recording,
        methods,
        closure_per_segment,
        attitudes_over_run,
        parameters,
        accelerometer,
        correlations,
        noise,
        denoising,
        explanation,
        explanation_by_truth,
        report_section,
        application,
        provenance,
    )
)
