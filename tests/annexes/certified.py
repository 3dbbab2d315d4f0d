"""A report's data with a certificate's fields, each a word of its own: what stands on the certificate can be traced to it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from session.io.config import config_of
from session.io.toml import parse_toml
from tinygc.estimation.verdict import decide
from tinygc.reporting.html.evidence import ReportData

#: sessions' folders without truth.json, which leaves a draft; the logs have paths of their own
RECORDED = TemporaryDirectory(prefix="tinygc-")
FIELDS = """
[board]
source = "sensor"
firmware = "Firmwareword"
registers = "5C5844E2"

[notes]
operator = "Noteoperator"
date = 2026-11-20

[certificate]
laboratory = "Laboratoryword"
address = "Labaddressword"
country = "DE"
customer = "Customerword"
customer_address = "Customeraddressword"
number = "Numberword-7"
amends = "Amendsword"
item = "Itemword"
manufacturer = "Manufacturerword"
condition = "Conditionword"
place = "Placeword"
performed_at = "customerBranch"
operator = "Operatorword"
authorised_by = "Authorword"
role = "Roleword"
received = 2026-11-16
calibrated = 2026-11-20
issued = 2026-11-23
valid_until = 2027-11-19
next_calibration = 2027-11-20
method = "Methodword"
deviations = "Deviationword"
conditions = "Environmentword"
external = "Externalword"
remarks = "Remarkword"

[certificate.traceability]
gravity = "Gravityword"
clock = "Clockword"
angle = "Angleword"

[[certificate.equipment]]
name = "Equipmentword"
identification = "Identificationword"
certificate = "Equipmentcertificateword"
due = 2027-05-31

[requirements]
rule = "guard band"
reference = "Specificationword"
[requirements.closure_deg]
upper = 5
[requirements.gyro_bias_mdps]
lower = -5000
upper = 5000
[requirements.accel_bias_mg]
upper = 100
"""


def with_fields(data: ReportData, fields: str = FIELDS, serial: str = "Serialword") -> ReportData:
    """The data of a report whose session.toml has these sections as well; nothing is fitted again."""
    session = data.fit.session
    folder = Path(RECORDED.name) / session.folder.name
    path = folder / "session.toml"
    if not path.exists():
        folder.mkdir()
        text = (session.folder / "session.toml").read_text(encoding="utf-8")
        path.write_text(text.replace("SIMULATED", "recorded"), encoding="utf-8")
    plain = path.read_text(encoding="utf-8")
    table = parse_toml(f"{plain}\n{fields}", str(path))
    table["sensor"] |= {"serial": serial, "clock_sigma_ppm": 20.0}
    config = replace(config_of(Path("session.toml"), table), accelerometer=session.config.accelerometer)
    problem = data.fit.problem.changed(session=replace(session, config=config, folder=folder))
    fit = replace(data.fit, problem=problem)
    files = [run.file for run in fit.runs]
    decision = decide(data.adopted, files, None, fit.against_raw, fit.accelerometer, [], fit.requirements)
    return replace(data, fit=fit, decision=decision)
