"""A certificate of a report's data: what it states, each from a field of session.toml or computed from the recording (certificate.md).

HTML for paper and the Digital Calibration Certificate (``dcc_file.py``) render it, and add no statement of their own.  What is required of
a certificate (ISO/IEC 17025:2017, 7.8.2.1 and 7.8.4.1) and is not there reads "not stated", and leaves the document a draft.
"""

from __future__ import annotations

import contextlib
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import date
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from session.base.errors import CalibrationError, FormatError
from session.base.files import open_file, result_folder
from session.base.names import CLOCKS
from session.base.numeric import rms_of
from session.base.results import write_text_whole
from session.base.texts import STANDIN_NAME, fixed, measured, significant
from session.base.toml import read_toml
from session.base.units import MDPS
from session.log.config import Config, read_config
from session.log.folder import Session, read_session
from session.log.lines import GZIP
from session.log.requirements import ATTITUDE, Rule
from tinygc.estimation.spread import ZERO
from tinygc.explanation.reported import LINEAR, ReportData
from tinygc.features.unit.certificate.dcc_file import dcc_text, require_fields
from tinygc.features.unit.certificate.given import CertificateGiven, Equipment, given_in, missing_fields, out_of_order
from tinygc.inference.decide import Conformity, Fact, share_words
from tinygc.inference.solve import Source, known_sources, total
from tinygc.library.arguments import public
from tinygc.library.reports import Report
from tinygc.models.files import load_with_table
from tinygc.models.linear import BIAS, PARAMETERS, LinearModel, field_facts
from tinygc.reporting.facts import Table, errors_table
from tinygc.reporting.html.markup import render
from tinygc.reporting.html.paper import print_pdf, require_browser
from tinygc.reporting.html.sections.front import recorded
from tinygc.verdict.requirements import closure_measured, rule_words, run_measured, sensor_measured

NOT_STATED = "not stated"
TITLE, DRAFT = "Calibration certificate", "Draft of a calibration certificate"
#: bytes of a file that show whether it is a certificate
ENOUGH = 4096
#: what begins the first line of a file that no sensor wrote
SIMULATED = "SIMULATED"
#: bytes that are read of a first line, and how a packed file begins
LONGEST_LINE = 4096
#: what a simulation leaves next to its recording
TRUTH = "truth.json"
#: a table of the recording's machine, next to its logs
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


@dataclass(frozen=True, eq=False, repr=False)
class Certificate:
    """Result of ``tinygc.certificate``: ``html``, ``dcc``, ``draft``, ``missing``, ``save(path)``, ``to_json()``.

    data: of the report; before, previous: the calibration in use until now, whose errors are stated as found, and its file.
    """

    data: ReportData
    before: LinearModel | None = None
    previous: str = ""

    def __repr__(self) -> str:
        return f"<Certificate {self.number}{': a draft' if self.draft else ''}>"

    @cached_property
    def html(self) -> str:
        """The certificate as one HTML document that needs nothing else."""
        return page(self)

    @cached_property
    def dcc(self) -> str:
        """The certificate as Digital Calibration Certificate, XML.  Raises CalibrationError for a draft."""
        return dcc_text(self)

    def save(self, path: Path | str, *, pdf: bool = False) -> list[Path]:
        """Write the HTML file, and the same as PDF next to it, which needs Chromium; returns the paths."""
        path = Path(path)
        if pdf:
            require_browser()
        with result_folder(path.parent):
            write_text_whole(path, self.html)
        return [path, *([print_pdf(path, path.with_suffix(".pdf"))] if pdf else [])]

    def save_dcc(self, path: Path | str) -> Path:
        """Write the Digital Calibration Certificate; returns its path.  Raises CalibrationError for a draft."""
        path, text = Path(path), self.dcc
        with result_folder(path.parent):
            write_text_whole(path, text)
        return path

    def to_json(self) -> dict:
        """``certificate`` of ``tinygc-report/1``."""
        return {"number": self.given.number or None, "draft": list(self.draft), "missing": list(self.missing)}

    # Whether it may be signed.

    @property
    def config(self) -> Config:
        """``session.toml``."""
        return self.data.fit.session.config

    @property
    def given(self) -> CertificateGiven:
        """The fields as the session has them."""
        return given_in(self.config)

    @property
    def number(self) -> str:
        """Of the certificate."""
        return self.given.number or NOT_STATED

    @property
    def missing(self) -> tuple[str, ...]:
        """Keys of session.toml that a certificate requires and that are not there."""
        return (*missing_fields(self.config), *([] if self.calibrated is not None else ["certificate.calibrated"]))

    @cached_property
    def draft(self) -> tuple[str, ...]:
        """Why it is a draft; empty of one that may be signed."""
        given, unsound, day = self.given, self.data.decision.unsound, self.calibrated
        reasons = [f"not stated: {', '.join(self.missing)}"] if self.missing else []
        if unsound:  # a value beyond its limits is a result; uncertainties that may not hold are none
            reasons.append(f"the calibration does not pass its own check: {'; '.join(unsound)}")
        if self.config.board.source == STANDIN_NAME:
            reasons.append("the board had no sensor: the samples are made up, or were played to it")
        if why := _simulated(self.data):
            reasons.append(f"the recording is simulated: {why}")
        # Days that each are one, and do not go together
        days = {"calibrated": day, **{key: getattr(given, key) for key in ("received", "issued", "valid_until", "next_calibration")}}
        if pair := out_of_order(days):
            reasons.append(f"{pair[1]} is {days[pair[1]]}, before {pair[0]}, {days[pair[0]]}")
        late = [each.name for each in given.equipment if day is not None and each.due is not None and each.due < day]
        return (*reasons, *([f"equipment was overdue on the day of the calibration: {', '.join(late)}"] if late else []))

    @property
    def line(self) -> str:
        """What is missing, in one line; empty where nothing is."""
        return f"certificate: a draft; {'; '.join(self.draft)}" if self.draft else ""

    # The item, the days and the conditions, by session.toml and the recording.

    @property
    def item(self) -> list[Line]:
        """What was calibrated."""
        given, sensor, board = self.given, self.config.sensor, self.config.board
        filters = f"CTRL1_XL to CTRL10_C read back as {board.registers}" if board.registers else "not stated by the board"
        return [
            ("Object", given.item or "inertial sensor: gyroscope with accelerometer", "certificate.item" if given.item else ""),
            *([("Manufacturer", given.manufacturer, "certificate.manufacturer")] if given.manufacturer else []),
            ("Model", sensor.model if self.config.model_given else NOT_STATED, "sensor.model"),
            ("Serial number", sensor.serial or NOT_STATED, "sensor.serial"),
            ("Ranges", f"±{sensor.gyro_fs_dps:g} °/s, ±{sensor.accel_fs_g:g} g", "sensor.gyro_fs_dps"),
            ("Data rate", self._rate_words, ""),
            ("Filter registers", filters, "board.registers" if board.registers else ""),
            *([("Firmware", board.firmware, "board.firmware")] if board.firmware else []),
            ("Condition", given.condition or NOT_STATED, "certificate.condition"),
        ]

    @property
    def _rate_words(self) -> str:
        if (nominal := self.data.fit.nominal_rate) is not None:
            return nominal.words
        rate_hz = 1 / np.median([log.samples.period_s for log in self.data.problem.logs])
        by = "the computer's clock" if self._by_arrivals else "the stamps"
        return f"{self.config.sensor.nominal_hz:g} Hz nominal, {rate_hz:.2f} Hz by {by}"

    @property
    def _by_arrivals(self) -> bool:
        """Whether the reference of time is the computer's second."""
        return self.data.fit.options.clock == CLOCKS[1]

    @cached_property
    def _calibrated(self) -> tuple[str, date | None]:
        """The day of the calibration, in words and as a date."""
        given, when = self.given.calibrated, recorded(self.data)
        day = None
        with contextlib.suppress(ValueError, TypeError):
            day = date.fromisoformat((when or "")[:10])
        if given is not None:
            return (str(given) if day in (None, given) else f"{given} (recorded {when})"), given
        return when or NOT_STATED, day

    @property
    def calibrated(self) -> date | None:
        """The day of the calibration, None where not known."""
        return self._calibrated[1]

    @property
    def dates(self) -> list[Line]:
        """Of the item's way through the laboratory."""
        given = self.given
        labels = {"valid_until": "Valid until", "next_calibration": "Next calibration"}
        return [
            ("Received", str(given.received or NOT_STATED), "certificate.received"),
            ("Calibrated", self._calibrated[0], "certificate.calibrated" if given.calibrated is not None else ""),
            ("Issued", str(given.issued or NOT_STATED), "certificate.issued"),
            *((label, str(day), f"certificate.{key}") for key, label in labels.items() if (day := getattr(given, key)) is not None),
            ("Computed", self.data.made, ""),
        ]

    @cached_property
    def temperature_c(self) -> tuple[float, float, float] | None:
        """Least, mean and largest temperature of the sensor over the logs, degC; None where it was not recorded."""
        logs = [log.samples.temp_c for log in self.data.problem.logs if log.samples.temp_c is not None]
        known = np.concatenate([each[np.isfinite(each)] for each in logs]) if logs else np.zeros(0)
        return (float(known.min()), float(known.mean()), float(known.max())) if len(known) else None

    @property
    def conditions(self) -> list[Line]:
        """Temperature, place and operator."""
        given, latitude, words = self.given, self.config.site.latitude_deg, "not recorded"
        if (temperature := self.temperature_c) is not None:
            words = f"{temperature[0]:.1f} to {temperature[2]:.1f} °C, mean {temperature[1]:.1f} °C, by the sensor's own thermometer"
        by = "notes.operator" if not given.operator and "operator" in self.config.notes else "certificate.operator"
        return [
            ("Sensor temperature", words, ""),
            ("Latitude", NOT_STATED if latitude is None else f"{latitude:g}°", "site.latitude_deg"),
            *([("Environment", given.conditions, "certificate.conditions")] if given.conditions else []),
            ("Place", given.place or NOT_STATED, "certificate.place"),
            ("Operator", self.operator or NOT_STATED, by),
        ]

    @property
    def operator(self) -> str:
        """Who calibrated, empty where it is not stated."""
        return self.given.operator or str(self.config.notes.get("operator", ""))

    @property
    def traceability(self) -> list[Line]:
        """How each reference is traceable, as it is stated, behind how it enters the calibration."""
        fit, sensor, protocol, site = self.data.fit, self.config.sensor, self.config.protocol, self.config.site
        gravity = "standard gravity, taken as known to 0.2 %" if site.gravity_mps2 is None else f"{site.gravity_mps2:g} m/s²"
        counted = fit.nominal_rate is not None
        clock = f"time by counting samples at {self._rate_words}" if counted else "time by the stamps of the item's board"
        if self._by_arrivals:
            clock = "time by the computer's second: the stamps of the item's board, divided by the measured ratio of the two clocks"
        if (off := sensor.clock_words) and not counted:
            clock += f": {off}, a deviation that is not corrected; U has it as a standard uncertainty"
        elif (sigma := sensor.clock_sigma) is not None and not counted:
            clock += f", {'which' if self._by_arrivals else 'whose clock'} is known to {measured(sigma * 1e6)} ppm (k = 1), which is in U"
        reference = fit.session.reference
        angle = REFERENCES.get(protocol.reference, INSTRUMENT).format(
            sigma=protocol.dial_sigma_deg if reference is None else reference.sigma_deg
        )
        if protocol.reference == "gravity":
            found = fit.accelerometer
            angle += ", which is not calibrated" if found.calibration.source == "none" else CALIBRATED[found.mode]
        stated = self.given.traceability
        return [
            (label, f"{entered}; {stated.get(key, f'traceability {NOT_STATED}')}", f"certificate.traceability.{key}")
            for label, key, entered in (("Gravity", "gravity", gravity), ("Clock", "clock", clock), ("Angle", "angle", angle))
        ]

    @cached_property
    def equipment(self) -> tuple[Equipment, ...]:
        """What is given, the machine whose description the recording keeps, gravity, and the clock of the stamps: what the scales are
        traced to.  Raises FormatError for a damaged description."""
        session, site, stated, machine = self.data.fit.session, self.config.site, self.given.traceability, list[Equipment]()
        path = session.folder / MACHINE
        if not session.in_memory and path.exists():
            make = read_toml(path).get("make")
            if not isinstance(make, str):
                raise FormatError(f"{path}: make is missing, expected text; correct it there, or remove the file")
            machine.append(Equipment(f"machine that turned the item, make {make}", f"description {MACHINE} of the recording"))
        gravity = "standard gravity" if site.gravity_mps2 is None else f"{site.gravity_mps2:g} m/s² at the place"
        clock = "samples counted at the nominal rate" if self.data.fit.nominal_rate is not None else "stamps of the item's board"
        clock = "the recording computer's, by the arrivals of the item's bytes" if self._by_arrivals else clock
        named = (("standard of force: gravity", gravity, "gravity"), ("standard of time: clock", clock, "clock"))
        return (*self.given.equipment, *machine, *(Equipment(name, which, stated.get(key, "")) for name, which, key in named))

    # Results.

    @cached_property
    def model(self) -> LinearModel:
        """E and B of ω = E m + B."""
        return LinearModel.from_vector(self.data.adopted.vector[:PARAMETERS])

    @cached_property
    def covariance(self) -> np.ndarray:
        """(12, 12) of E and B."""
        return self.data.adopted.covariance[:PARAMETERS, :PARAMETERS]

    @cached_property
    def sources(self) -> tuple[Source, ...]:
        """Of the covariance."""
        return known_sources(self.data.adopted.sources, self.covariance)

    def _gyroscope(self, sources: Sequence[Source], turned: np.ndarray | None = None) -> list[Fact]:
        """The sensor errors of the model, with U that includes one effect missing from the model, as large as the recording allows;
        turned (12, 12): derivative of another model by the one that was fitted."""
        allowed, vector = self.data.adopted.allowed, self.model.vector
        if turned is not None:
            vector, sources = turned @ vector, [each.through(turned) for each in sources]

        def moved(slope: np.ndarray) -> np.ndarray:
            assert allowed is not None
            return allowed.of(slope if turned is None else slope @ turned)

        unobserved = self.data.adopted.unobserved
        return sensor_measured("gyro", field_facts(vector, total(sources), unobserved, None if allowed is None else moved, sources))

    @cached_property
    def results(self) -> list[Fact]:
        """Errors of the sensor, without correction."""
        data, found = self.data, self._gyroscope(self.sources)
        if not (between := data.fit.spread.at(ZERO)).is_usual:
            spread = np.zeros((PARAMETERS, PARAMETERS))
            spread[BIAS, BIAS] = between.two_draws
            again = self._gyroscope([*self.sources, Source("switch-on", "B", float("inf"), spread)])
            found += [replace(q, word=f"{q.word} at any switch-on", key="") for q in again if q.word == "gyroscope bias"]
        # one that was taken as given is no result of this calibration
        found += [each for each in sensor_measured("accel", data.fit.accelerometer.facts) if np.isfinite(each.sigma)]
        beyond = [q for q in data.quantities if q not in data.adopted.quantities and q.observed]
        return found + [replace(q, word=f"gyroscope {q.word}") for q in beyond]

    @cached_property
    def as_found(self) -> list[Fact]:
        """Errors of the output as the previous calibration corrects it, w0 = E0 m + B0: that of w0 is E E0^-1, B - E E0^-1 B0."""
        if self.before is None:
            return []
        undone = np.linalg.inv(self.before.E)
        turned = np.zeros((PARAMETERS, PARAMETERS))
        turned[:9, :9] = np.kron(np.eye(3), undone.T)
        turned[BIAS, :9] = -np.kron(np.eye(3), undone @ self.before.B)
        turned[BIAS, BIAS] = np.eye(3)
        return self._gyroscope(self.sources, turned)

    @cached_property
    def closure(self) -> list[tuple[Fact, float]]:
        """Of segments and closure runs, with the floor of each in degrees."""
        adopted = self.data.adopted
        runs = zip(self.data.fit.runs, adopted.run_errors, strict=True)
        found = [(closure_measured(adopted.angles, adopted.numbers), adopted.floor_rms)]
        found += [(run_measured(run.file, error, run.floor_rad), rms_of(run.floor_rad)) for run, error in runs]
        return [(each, float(np.degrees(floor))) for each, floor in found]

    @cached_property
    def statements(self) -> list[tuple[str, str, list[Conformity]]]:
        """Of conformity, one for each origin of limits and each rule, in the order of the values: the origin, the rule in words, the
        values."""
        groups: dict[tuple[str, Rule], list[Conformity]] = {}
        for each in self.data.decision.conformities:
            groups.setdefault((each.reference, each.rule), []).append(each)
        found = []
        for (reference, rule), of in groups.items():
            sentences = [rule_words(rule)]
            if any(np.isfinite(each.measured.sigma) for each in of):
                sentences.append("The risk is that of the value with its U, without prior knowledge of the item (JCGM 106:2012, 7.2).")
            found.append((reference, " ".join(sentences), of))
        return found

    # Sentences.

    @property
    def method(self) -> list[str]:
        """How it was calibrated."""
        data, problem = self.data, self.data.problem
        rests = len(problem.references)
        counts = f"{len(problem.used)} turns of {len(problem.segments)}"
        turned = f"The item was turned from rest to rest: {counts} are used, between {rests} rests."
        if data.fit.session.reference is not None:
            turned = f"The item was moved; {len(problem.used)} stretches of {len(problem.segments)} between known attitudes are used."
        sentences = [
            turned,
            f"Attitudes come from {REFERENCES.get(self.config.protocol.reference, INSTRUMENT).split(', one')[0]}.",
            "The calibration ω = E m + B of the measured rates m is that with which the integrated rates of each turn end in the known "
            "attitude behind it, by weighted least squares; closure is stated of turns that the fit did not use.",
        ]
        if data.adopted.name != LINEAR:
            sentences.append(f"The model has further effects: {', '.join(claim.effect.id for claim in data.adopted.claims)}.")
        return [*sentences, f"Procedure: {self.given.method or NOT_STATED}. Computed by TinyGC {data.versions['TinyGC']}, docs/model.md."]

    @property
    def uncertainty(self) -> list[str]:
        """What U is, and what it holds."""
        adopted, factors = self.data.adopted, [each.factor for each in self._gyroscope(self.sources)]
        low, high = (fixed(each, 2) for each in (min(factors), max(factors)))
        sentences = [
            "U is the expanded uncertainty: the standard uncertainty multiplied by the coverage factor k that is stated, for a coverage "
            f"probability of approximately 95 %; k is {low if low == high else f'{low} to {high}'} for the gyroscope, by the effective "
            "degrees of freedom (JCGM 100:2008, annex G)."
        ]
        if adopted.sources:
            sentences.append(f"Contributions: {', '.join(f'{each.name} ({each.kind})' for each in self.sources)}.")
        else:
            sentences.append("It includes the noise of rates and rests that the recording shows, and that of references estimated with it.")
        if adopted.name == LINEAR and self.data.fit.widened > 1:
            factor = significant(float(np.sqrt(self.data.fit.widened)), 3)
            sentences.append(f"The turns scatter by more than this noise; standard uncertainties are multiplied by {factor} for it.")
        if adopted.allowed is not None:
            most = [q for q in adopted.quantities if np.isfinite(q.moved)]
            groups = {q.word: max(abs(each.moved) for each in most if each.word == q.word) for q in most}
            units = {q.word: q.unit for q in most}
            sizes = ", ".join(f"{word} {significant(size, 2)} {units[word]}" for word, size in groups.items())
            if sizes:
                sentences.append(f"U includes one effect missing from the model, as large as this recording allows: {sizes} (k = 1, B).")
        return sentences

    @property
    def remarks(self) -> list[str]:
        """What else a reader is to know."""
        sentences = [
            "The results relate only to the item identified above, as it was calibrated.",
            "This document shall not be reproduced except in full without the approval of the laboratory.",
        ]
        spread, given = self.data.fit.spread.at(ZERO), self.given
        if spread.is_usual:
            sentences.append("The bias is that of this switch-on; how far it changes between switch-ons was not evaluated.")
        else:
            sizes = ", ".join(significant(each / MDPS, 2) for each in spread.sigma)
            sentences.append(f"The bias changes between switch-ons by {sizes} mdps (one sigma; {spread.source}).")
        sentences += [f"In doubt: {doubt}." for doubt in self.data.decision.doubts]
        external = "Results of external providers"
        for label, key in (("Deviations from the method", "deviations"), (external, "external"), ("Remarks", "remarks")):
            if text := getattr(given, key):
                sentences.append(f"{label}: {text}")
        return sentences + ([f"This certificate replaces certificate {given.amends}."] if given.amends else [])


def _simulated(data: ReportData) -> str:
    """Why the recording is known to be simulated; empty where it is not."""
    session = data.fit.session
    if not session.in_memory and (session.folder / TRUTH).exists():
        return f"{TRUTH} is in its folder"
    paths = [] if session.in_memory else [session.folder / "session.toml", *(log.path for log in session.logs)]
    marked = [path.name for path in paths if path.is_file() and SIMULATED in _first_line(path)]
    return f"by the first line of {marked[0]}" if marked else ""


def _first_line(path: Path) -> str:
    """The first line of a text file, packed by gzip or not, as far as it is short."""
    with open_file(path) as file:
        head = file.read(LONGEST_LINE)
    if head.startswith(GZIP):
        with contextlib.suppress(zlib.error):
            head = zlib.decompressobj(16 + zlib.MAX_WBITS).decompress(head, LONGEST_LINE)
    return head.split(b"\n", 1)[0].decode("utf-8", "replace")


# The HTML document for paper: A4, the number and page x of y on every sheet; nothing is fetched, nothing runs.


def page(c: Certificate) -> str:
    """The certificate as HTML."""
    title = DRAFT if c.draft else TITLE
    number = f"{'draft, ' if c.draft else ''}certificate number {c.number}"
    model = zip("xyz", c.model.E, c.model.B, strict=True)
    rows = [[axis, *(fixed(each, 6) for each in row), fixed(bias, 7)] for axis, row, bias in model]
    closure = [[_first(each.name), each.stated, _factor(each), significant(floor, 2)] for each, floor in c.closure]
    return render(
        "certificate.html",
        "tinygc.features.unit.certificate",
        c=c,
        title=title,
        running={"bottom-left": number},
        results=errors_table("", c.results, expanded=True),
        found=errors_table("", c.as_found, expanded=True),
        model=Table("", ("ω = E m + B", "E, of m x", "E, of m y", "E, of m z", "B, rad/s"), rows),
        closure=Table("", ("Closure with it, degrees", "Value ± U", "k", "Noise alone"), closure),
        statements=[(reference, rule, _conformities(each)) for reference, rule, each in c.statements],
    ).lstrip()


def _first(words: str) -> str:
    return f"{words[:1].upper()}{words[1:]}"


def _factor(each: Fact) -> str:
    return fixed(each.factor, 2) if each.observed and each.expanded > 0 else ""


def _conformities(conformities: Sequence[Conformity]) -> Table:
    rows = []
    for each in conformities:
        m = each.measured
        risk = "not known"
        if m.key == ATTITUDE:
            risk = "none: an uncertainty"
        elif each.risk is not None:
            risk = share_words(each.risk)
        elif m.observed and np.isfinite(m.u):
            risk = f"PASS {share_words(1 - each.probability)}, FAIL {share_words(each.probability)}"
        rows.append([f"{_first(m.name)}, {m.unit}", each.limit_words, m.stated, _factor(m), each.answer.upper(), risk])
    return Table("", ("Requirement", "Limits", "Value ± U", "k", "Answer", "Risk that it is wrong"), rows)


# Before it is made.


def check_before(folder: Path, form: Path | None, dcc: Path | None, as_found: Path | None) -> None:
    """Refuse, before a fit, what its certificate would fail at.

    Raises CalibrationError where a certificate that is no draft lies at one of the two paths, where the time base is not calibrated, and
    where session.toml does not have what a Digital Calibration Certificate needs; FormatError for a damaged session.toml or model.
    """
    for path, mark in ((form, f"<title>{TITLE} "), (dcc, "digitalCalibrationCertificate")):
        if path is None or not path.is_file():
            continue
        with open_file(path) as stream:
            begins = stream.read(ENOUGH)
        if mark.encode() in begins:
            raise CalibrationError(f"{path}: holds a certificate, which may be issued; move it to its place, or give another file")
    if as_found is not None:
        _linear(as_found)
    if (toml := folder / "session.toml").is_file():
        if dcc is not None:
            require_fields(read_config(toml))
        _require_clock(read_session(folder))


def _require_clock(session: Session) -> None:
    """Raise CalibrationError for a session whose clock's error is not known: no U of a scale factor would include it."""
    if not session.clock_known:
        raise CalibrationError("no certificate: time base not calibrated; give sensor.clock_sigma_ppm")


@public()
def certificate(report: Any, as_found: Path | str | None = None) -> Certificate:
    """Make the form that a laboratory signs, of a report.

    Parameters
    ----------
    report : Report
        The report whose numbers it states.
    as_found : str or Path, optional
        Model file of the calibration in use until now, whose errors are then stated.

    Returns
    -------
    Certificate
        ``html``, ``dcc``, ``draft``, ``missing``, ``save(path, pdf=False)``, ``save_dcc(path)``.

    Raises
    ------
    CalibrationError
        For a clock whose error is not known, and for a file that is no linear model.

    Examples
    --------
    >>> import tinygc
    >>> tinygc.certificate(tinygc.report("data/session1")).save("certificate.html")  # doctest: +SKIP

    """
    if not isinstance(report, Report):
        raise CalibrationError(f"report is of type {type(report).__name__}, expected a report: tinygc.report(session)")
    _require_clock(report.data.fit.session)
    if as_found is None:
        return Certificate(report.data)
    return Certificate(report.data, _linear(as_found), Path(as_found).name)


def _linear(path: Path | str) -> LinearModel:
    """The model in use until now.  Raises FormatError for another kind of model."""
    model, _ = load_with_table(path)
    if not isinstance(model, LinearModel):
        raise FormatError(f"{path}: a model of kind {model.kind}, expected a linear one; give model_least_squares.json")
    return model
