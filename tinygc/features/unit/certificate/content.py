"""What a certificate states, as text and numbers: each from a field of session.toml, or computed from the recording (certificate.md).

``page.py`` prints it, ``dcc_file.py`` writes it as XML; neither adds a statement of its own about this calibration.  What is required of a
certificate (ISO/IEC 17025:2017, 7.8.2.1 and 7.8.4.1) and is not there reads "not stated", and leaves the document a draft.
"""

from __future__ import annotations

import contextlib
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path

import numpy as np

from session.base.errors import FormatError
from session.base.files import open_file
from session.base.names import CLOCKS
from session.base.numeric import rms_of
from session.base.texts import STANDIN_NAME, fixed, significant
from session.base.toml import read_toml
from session.base.units import MDPS
from session.log.config import Config
from session.log.lines import GZIP
from session.log.requirements import Rule
from tinygc.estimation.spread import ZERO
from tinygc.explanation.reported import LINEAR, ReportData
from tinygc.features.unit.certificate.given import TRACED, CertificateGiven, Equipment, given_in, out_of_order
from tinygc.inference.decide import Conformity, Fact
from tinygc.inference.solve import Source, known_sources, total
from tinygc.models.linear import BIAS, PARAMETERS, LinearModel, field_facts
from tinygc.reporting.html.sections.front import SOURCES, recorded
from tinygc.verdict.requirements import closure_measured, rule_words, run_measured, sensor_measured

NOT_STATED = "not stated"
#: what U holds beside the fit's own sources
LACKING = "one effect that the model lacks"
#: what begins the first line of a file that no sensor wrote
SIMULATED = "SIMULATED"
#: bytes that are read of a first line, and how a packed file begins
LONGEST_LINE = 4096
#: what a simulation leaves beside its recording
TRUTH = "truth.json"
#: fields that a certificate must have -> what they are, in words
REQUIRED = {
    "laboratory": "name of the laboratory",
    "address": "address of the laboratory",
    "number": "number of the certificate",
    "customer": "name of the customer",
    "customer_address": "address of the customer",
    "place": "place of the calibration",
    "method": "reference of the procedure",
    "issued": "date of issue",
    "authorised_by": "who authorises it",
}
#: a table of the recording's machine, beside its logs
MACHINE = "table.toml"
#: how attitudes are known, by the reference; a further one is another instrument
REFERENCES = {
    "gravity": "the direction of gravity in each rest, by the accelerometer of the item itself",
    "table": "the dials of the table, one sigma {sigma:g}°",
}


INSTRUMENT = "attitudes of another instrument, one sigma {sigma:g}°"

#: how the accelerometer was calibrated, by the mode of its fit
CALIBRATED = {
    "given": ", its calibration taken as session.toml gives it",
    "prior": ", its given calibration refined by this recording",
    "fit": ", calibrated by this recording",
}


#: a line of the certificate: label, text, and the key of session.toml that holds it, empty where it is computed from the recording
Line = tuple[str, str, str]


@dataclass(frozen=True, eq=False)
class Content:
    """A certificate.

    number; draft: reasons for which it is none; missing: keys of session.toml that are not there; given: the fields as the session has
    them; item, dates, conditions, traceability: lines; equipment; results; as_found: the same of the output as a previous calibration
    corrects it, previous: its file; closure: of segments and closure runs, with the floor of each in degrees; statements of conformity:
    where the limits are from, the decision rule in words, and each value against its limits; operator: who calibrated, empty where nobody
    is stated; method, uncertainty, remarks: sentences; calibrated: (first, last) day, None where not known; model and covariance (12, 12)
    of ω = E m + B; temperature_c: (least, mean, largest) of the sensor, None where it was not recorded.
    """

    number: str
    draft: tuple[str, ...]
    missing: tuple[str, ...]
    given: CertificateGiven
    config: Config
    item: list[Line]
    dates: list[Line]
    conditions: list[Line]
    traceability: list[Line]
    equipment: tuple[Equipment, ...]
    results: list[Fact]
    as_found: list[Fact]
    previous: str
    closure: list[tuple[Fact, float]]
    statements: list[tuple[str, str, list[Conformity]]]
    operator: str
    method: list[str]
    uncertainty: list[str]
    remarks: list[str]
    calibrated: date | None
    model: LinearModel
    covariance: np.ndarray
    temperature_c: tuple[float, float, float] | None

    @property
    def conformity(self) -> list[Conformity]:
        """Each value that has limits, of all statements."""
        return [each for *_, conformities in self.statements for each in conformities]


def missing_fields(config: Config) -> list[str]:
    """Keys of session.toml that a certificate must have, whatever was recorded, and that are not there."""
    given = given_in(config)
    missing = [f"certificate.{key}" for key in REQUIRED if not getattr(given, key)]
    missing += [] if config.sensor.serial else ["sensor.serial"]
    missing += [] if config.model_given else ["sensor.model"]
    return missing + [f"certificate.traceability.{key}" for key in TRACED if key not in given.traceability]


def content_of(data: ReportData, previous: tuple[str, LinearModel] | None = None) -> Content:
    """What the certificate of a report's data states; previous: file name and model of the calibration in use until now.

    Raises FormatError for a damaged table.toml of the session.
    """
    config = data.fit.session.config
    given, vector = given_in(config), data.adopted.vector[:PARAMETERS]
    covariance = data.adopted.covariance[:PARAMETERS, :PARAMETERS]
    sources = known_sources(data.adopted.sources, covariance)
    calibrated, day = _calibrated(data)
    missing = missing_fields(config) + ([] if day is not None else ["certificate.calibrated"])
    draft = [f"not stated: {', '.join(missing)}"] if missing else []
    if data.decision.unsound:  # a value beyond its limits is a result; uncertainties that may not hold are none
        draft.append(f"the calibration does not pass its own check: {'; '.join(data.decision.unsound)}")
    if config.board.source == STANDIN_NAME:
        draft.append("the board had no sensor: the samples are made up, or were played to it")
    if why := _simulated(data):
        draft.append(f"the recording is simulated: {why}")
    if not data.fit.session.clock_known:
        draft.append("the clock's error is not known and is in no U of a scale factor: give sensor.clock_sigma_ppm")
    # Reasons against days that each are one, and do not go together
    found = []
    days = {"calibrated": day, **{key: getattr(given, key) for key in ("received", "issued", "valid_until", "next_calibration")}}
    if pair := out_of_order(days):
        found.append(f"{pair[1]} is {days[pair[1]]}, before {pair[0]}, {days[pair[0]]}")
    late = [each.name for each in given.equipment if day is not None and each.due is not None and each.due < day]
    draft += found + ([f"equipment was overdue on the day of the calibration: {', '.join(late)}"] if late else [])
    machine = _machine(data)
    return Content(
        number=given.number or NOT_STATED,
        draft=tuple(draft),
        missing=tuple(missing),
        given=given,
        config=config,
        item=_item(data),
        dates=[*_dates(given, calibrated), ("Computed", data.made, "")],
        conditions=_conditions(data),
        traceability=_traceability(data),
        equipment=given.equipment + ((machine,) if machine is not None else ()) + _standards(data),
        results=_results(data, vector, sources),
        as_found=[] if previous is None else _as_found(previous[1], data, vector, sources),
        previous="" if previous is None else previous[0],
        closure=_closure(data),
        statements=_statements(data.decision.conformities),
        operator=_operator(config)[0],
        method=_method(data),
        uncertainty=_uncertainty(data, sources, vector),
        remarks=_remarks(data, given),
        calibrated=day,
        model=LinearModel.from_vector(vector),
        covariance=covariance,
        temperature_c=_temperature(data),
    )


# What session.toml and the recording say of the item, the days and the conditions.


def _item(data: ReportData) -> list[Line]:
    config, given = data.fit.session.config, given_in(data.fit.session.config)
    sensor, board = config.sensor, config.board
    filters = f"CTRL1_XL to CTRL10_C read back as {board.registers}" if board.registers else "not stated by the board"
    rows = [
        ("Object", given.item or "inertial sensor: gyroscope with accelerometer", "certificate.item" if given.item else ""),
        *([("Manufacturer", given.manufacturer, "certificate.manufacturer")] if given.manufacturer else []),
        ("Model", sensor.model if config.model_given else NOT_STATED, "sensor.model"),
        ("Serial number", sensor.serial or NOT_STATED, "sensor.serial"),
        ("Ranges", f"±{sensor.gyro_fs_dps:g} °/s, ±{sensor.accel_fs_g:g} g", "sensor.gyro_fs_dps"),
        ("Data rate", _rate_words(data), ""),
        ("Filter registers", filters, "board.registers" if board.registers else ""),
    ]
    if board.firmware:
        rows.append(("Firmware", board.firmware, "board.firmware"))
    return [*rows, ("Condition", given.condition or NOT_STATED, "certificate.condition")]


def _rate_words(data: ReportData) -> str:
    nominal, config = data.fit.nominal_rate, data.fit.session.config
    if nominal is not None:
        return nominal.words
    rate_hz = 1 / np.median([log.samples.period_s for log in data.problem.logs])
    by = "the computer's clock" if _by_arrivals(data) else "the stamps"
    return f"{config.sensor.nominal_hz:g} Hz nominal, {rate_hz:.2f} Hz by {by}"


def _by_arrivals(data: ReportData) -> bool:
    """Whether the reference of time is the computer's second."""
    return data.fit.options.clock == CLOCKS[1]


def _calibrated(data: ReportData) -> tuple[str, date | None]:
    """The day of the calibration, in words and as a date; no date where only the file's time tells."""
    given = given_in(data.fit.session.config).calibrated
    when, source = recorded(data)
    day = None
    with contextlib.suppress(ValueError, TypeError):
        day = None if source == "file" else date.fromisoformat((when or "")[:10])
    if given is not None:
        return (str(given) if day in (None, given) else f"{given} (recorded {when})"), given
    return (NOT_STATED if when is None else f"{when}{SOURCES[source]}"), day


def _dates(given: CertificateGiven, calibrated: str) -> list[Line]:
    rows = [
        ("Received", str(given.received or NOT_STATED), "certificate.received"),
        ("Calibrated", calibrated, "certificate.calibrated" if given.calibrated is not None else ""),
        ("Issued", str(given.issued or NOT_STATED), "certificate.issued"),
    ]
    for label, key in (("Valid until", "valid_until"), ("Next calibration", "next_calibration")):
        if (day := getattr(given, key)) is not None:
            rows.append((label, str(day), f"certificate.{key}"))
    return rows


def _temperature(data: ReportData) -> tuple[float, float, float] | None:
    """Least, mean and largest temperature of the sensor over the logs, degC."""
    logs = [log.samples.temp_c for log in data.problem.logs if log.samples.temp_c is not None]
    known = np.concatenate([each[np.isfinite(each)] for each in logs]) if logs else np.zeros(0)
    return (float(known.min()), float(known.mean()), float(known.max())) if len(known) else None


def _conditions(data: ReportData) -> list[Line]:
    config, temperature = data.fit.session.config, _temperature(data)
    site = config.site
    words = "not recorded"
    if temperature is not None:
        words = f"{temperature[0]:.1f} to {temperature[2]:.1f} °C, mean {temperature[1]:.1f} °C, by the sensor's own thermometer"
    rows = [
        ("Sensor temperature", words, ""),
        ("Latitude", NOT_STATED if site.latitude_deg is None else f"{site.latitude_deg:g}°", "site.latitude_deg"),
    ]
    given = given_in(config)
    if given.conditions:
        rows.append(("Environment", given.conditions, "certificate.conditions"))
    operator, key = _operator(config)
    return [*rows, ("Place", given.place or NOT_STATED, "certificate.place"), ("Operator", operator or NOT_STATED, key)]


def _operator(config: Config) -> tuple[str, str]:
    """Who calibrated, empty where nobody is stated, and the key that says so."""
    if not given_in(config).operator and "operator" in config.notes:
        return str(config.notes["operator"]), "notes.operator"
    return given_in(config).operator, "certificate.operator"


def _traceability(data: ReportData) -> list[Line]:
    """How each reference is traceable, as it is stated, behind how it enters the calibration."""
    config = data.fit.session.config
    site, protocol, stated = config.site, config.protocol, given_in(config).traceability
    gravity = "standard gravity, taken as known to 0.2 %" if site.gravity_mps2 is None else f"{site.gravity_mps2:g} m/s²"
    counted = data.fit.nominal_rate is not None
    clock = f"time by counting samples at {_rate_words(data)}" if counted else "time by the stamps of the item's board"
    if _by_arrivals(data):
        clock = "time by the computer's second: the stamps of the item's board, divided by the measured ratio of the two clocks"
    if not data.fit.session.clock_known:
        clock += ", whose clock's error is not known"
    elif (off := config.sensor.clock_words) and not counted:
        clock += f": {off}, a deviation that is not corrected; U has it as a standard uncertainty"
    elif (sigma := config.sensor.clock_sigma) is not None and not counted:
        clock += f", {'which' if _by_arrivals(data) else 'whose clock'} is known to {sigma * 1e6:.4g} ppm (k = 1), which is in U"
    reference = data.fit.session.reference
    angle = REFERENCES.get(protocol.reference, INSTRUMENT).format(
        sigma=protocol.dial_sigma_deg if reference is None else reference.sigma_deg
    )
    if protocol.reference == "gravity":
        found = data.fit.accelerometer
        angle += ", which is not calibrated" if found.calibration.source == "none" else CALIBRATED[found.mode]
    return [
        (label, f"{entered}; {stated.get(key, f'traceability {NOT_STATED}')}", f"certificate.traceability.{key}")
        for label, key, entered in (("Gravity", "gravity", gravity), ("Clock", "clock", clock), ("Angle", "angle", angle))
    ]


def _machine(data: ReportData) -> Equipment | None:
    """The machine whose description the recording keeps."""
    session = data.fit.session
    path = session.folder / MACHINE
    if session.in_memory or not path.exists():
        return None
    make = read_toml(path).get("make")
    if not isinstance(make, str):
        raise FormatError(f"{path}: make is missing, expected text; correct it there, or remove the file")
    return Equipment(f"machine that turned the item, make {make}", f"description {MACHINE} of the recording")


def _standards(data: ReportData) -> tuple[Equipment, ...]:
    """Gravity, and the clock of the stamps: what the scales are traced to."""
    site, stated = data.fit.session.config.site, given_in(data.fit.session.config).traceability
    gravity = "standard gravity" if site.gravity_mps2 is None else f"{site.gravity_mps2:g} m/s² at the place"
    clock = "samples counted at the nominal rate" if data.fit.nominal_rate is not None else "stamps of the item's board"
    clock = "the recording computer's, by the arrivals of the item's bytes" if _by_arrivals(data) else clock
    named = (("standard of force: gravity", gravity, "gravity"), ("standard of time: clock", clock, "clock"))
    return tuple(Equipment(name, identification, stated.get(key, "")) for name, identification, key in named)


def _simulated(data: ReportData) -> str:
    """Why the recording is known to be simulated; empty where nothing says so."""
    session = data.fit.session
    if not session.in_memory and (session.folder / TRUTH).exists():
        return f"{TRUTH} lies beside it"
    paths = [] if session.in_memory else [session.folder / "session.toml", *(log.path for log in session.logs)]
    marked = [path.name for path in paths if path.is_file() and SIMULATED in _first_line(path)]
    return f"the first line of {marked[0]} says so" if marked else ""


def _first_line(path: Path) -> str:
    """The first line of a text file, packed by gzip or not, as far as it is short."""
    with open_file(path) as file:
        head = file.read(LONGEST_LINE)
    if head.startswith(GZIP):
        with contextlib.suppress(zlib.error):
            head = zlib.decompressobj(16 + zlib.MAX_WBITS).decompress(head, LONGEST_LINE)
    return head.split(b"\n", 1)[0].decode("utf-8", "replace")


def _statements(conformities: Sequence[Conformity]) -> list[tuple[str, str, list[Conformity]]]:
    """One for each origin of limits and each rule, in the order of the values."""
    groups: dict[tuple[str, Rule], list[Conformity]] = {}
    for each in conformities:
        groups.setdefault((each.reference, each.rule), []).append(each)
    found = []
    for (reference, rule), of in groups.items():
        said = [rule_words(rule)]
        if any(np.isfinite(each.measured.sigma) for each in of):
            said.append("The risk is that of the measured value with its U, without prior knowledge of the item (JCGM 106:2012, 7.2).")
        found.append((reference, " ".join(said), of))
    return found


# Results.


def _gyroscope(data: ReportData, vector: np.ndarray, sources: Sequence[Source], turned: np.ndarray | None = None) -> list[Fact]:
    """The sensor errors of a model (12,), with U that holds the largest effect that the model lacks and the recording does not exclude.

    turned (12, 12): derivative of the model by the one that was fitted, where it is another.
    """
    allowed = data.adopted.allowed

    def moved(slope: np.ndarray) -> np.ndarray:
        assert allowed is not None
        return allowed.of(slope if turned is None else slope @ turned)

    return sensor_measured(
        "gyro", field_facts(vector, total(sources), data.adopted.unobserved, None if allowed is None else moved, sources)
    )


def _results(data: ReportData, vector: np.ndarray, sources: Sequence[Source]) -> list[Fact]:
    found = _gyroscope(data, vector, sources)
    if not (between := data.fit.spread.at(ZERO)).is_usual:
        spread = np.zeros((PARAMETERS, PARAMETERS))
        spread[BIAS, BIAS] = between.two_draws
        again = _gyroscope(data, vector, [*sources, Source("switch-on", "B", float("inf"), spread)])
        found += [replace(q, word=f"{q.word} at any switch-on", key="") for q in again if q.word == "gyroscope bias"]
    # one that was taken as given is no result of this calibration
    found += [each for each in sensor_measured("accel", data.fit.accelerometer.facts) if np.isfinite(each.sigma)]
    beyond = [q for q in data.quantities if q not in data.adopted.quantities and q.observed]
    return found + [replace(q, word=f"gyroscope {q.word}") for q in beyond]


def _as_found(previous: LinearModel, data: ReportData, vector: np.ndarray, sources: Sequence[Source]) -> list[Fact]:
    """Errors of the output as the previous calibration corrects it, w0 = E0 m + B0: the calibration of w0 is E E0^-1, B - E E0^-1 B0."""
    undone = np.linalg.inv(previous.E)
    turned = np.zeros((PARAMETERS, PARAMETERS))
    turned[:9, :9] = np.kron(np.eye(3), undone.T)
    turned[BIAS, :9] = -np.kron(np.eye(3), undone @ previous.B)
    turned[BIAS, BIAS] = np.eye(3)
    moved = [replace(each, covariance=turned @ each.covariance @ turned.T) for each in sources]
    return _gyroscope(data, turned @ vector, moved, turned)


def _closure(data: ReportData) -> list[tuple[Fact, float]]:
    adopted = data.adopted
    runs = zip(data.fit.runs, adopted.run_errors, strict=True)
    found = [(closure_measured(adopted.angles, adopted.numbers), adopted.floor_rms)]
    found += [(run_measured(run.file, error, run.floor_rad), rms_of(run.floor_rad)) for run, error in runs]
    return [(each, float(np.degrees(floor))) for each, floor in found]


# Sentences.


def _method(data: ReportData) -> list[str]:
    config, problem = data.fit.session.config, data.problem
    rests = sum(still.problem is None for still in problem.stills)
    turned = f"The item was turned from rest to rest: {len(problem.used)} turns of {len(problem.segments)} are used, between {rests} rests."
    if data.fit.session.reference is not None:
        turned = f"The item was moved; {len(problem.used)} stretches of {len(problem.segments)} between known attitudes are used."
    said = [
        turned,
        f"Attitudes come from {REFERENCES.get(config.protocol.reference, INSTRUMENT).split(', one')[0]}.",
        "The calibration ω = E m + B of the measured rates m is that with which the integrated rates of each turn end in the known "
        "attitude behind it, by weighted least squares; closure is stated of turns that the fit did not use.",
    ]
    if data.adopted.name != LINEAR:
        said.append(f"The model has further effects: {', '.join(claim.effect.id for claim in data.adopted.claims)}.")
    reference = given_in(config).method
    return [*said, f"Procedure: {reference or NOT_STATED}. Computed by TinyGC {data.versions['TinyGC']}, docs/model.md."]


def _uncertainty(data: ReportData, sources: Sequence[Source], vector: np.ndarray) -> list[str]:
    factors = [each.factor for each in _gyroscope(data, vector, sources)]
    low, high = (fixed(each, 2) for each in (min(factors), max(factors)))
    said = [
        "U is the expanded uncertainty: the standard uncertainty multiplied by the coverage factor k that is stated, for a coverage "
        f"probability of approximately 95 %; k is {low if low == high else f'{low} to {high}'} for the gyroscope, by the effective degrees "
        "of freedom (JCGM 100:2008, annex G)."
    ]
    if data.adopted.sources:
        said.append(f"Contributions: {', '.join(f'{each.name} ({each.kind})' for each in sources)}.")
    else:
        said.append("It includes the noise of rates and rests that the recording shows, and that of references estimated with it.")
    if data.adopted.name == LINEAR and data.fit.widened > 1:
        factor = significant(float(np.sqrt(data.fit.widened)), 3)
        said.append(f"The turns scatter by more than this noise; standard uncertainties are multiplied by {factor} for it.")
    if data.adopted.allowed is not None:
        most = [q for q in data.adopted.quantities if np.isfinite(q.moved)]
        groups = {q.word: max(abs(each.moved) for each in most if each.word == q.word) for q in most}
        units = {q.word: q.unit for q in most}
        sizes = ", ".join(f"{word} {significant(size, 2)} {units[word]}" for word, size in groups.items())
        if sizes:
            said.append(f"U holds {LACKING} and this recording does not exclude: {sizes} (k = 1, B).")
    return said


def _remarks(data: ReportData, given: CertificateGiven) -> list[str]:
    said = [
        "The results relate only to the item identified above, as it was calibrated.",
        "This document shall not be reproduced except in full without the approval of the laboratory.",
    ]
    spread = data.fit.spread.at(ZERO)
    if spread.is_usual:
        said.append("The bias is that of this switch-on; how far it changes between switch-ons was not evaluated.")
    else:
        sizes = ", ".join(significant(each / MDPS, 2) for each in spread.sigma)
        said.append(f"The bias changes between switch-ons by {sizes} mdps (one sigma; {spread.source}).")
    said += [f"In doubt: {doubt}." for doubt in data.decision.doubts]
    for label, key in (("Deviations from the method", "deviations"), ("Results of external providers", "external"), ("Remarks", "remarks")):
        if text := getattr(given, key):
            said.append(f"{label}: {text}")
    return said + ([f"This certificate replaces certificate {given.amends}."] if given.amends else [])
