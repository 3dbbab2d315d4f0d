"""``tinygc.verify``: whether a stored calibration still holds, of a feature."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from session.base.errors import CalibrationError
from session.base.features import need
from session.log.dialects import Answers
from session.log.folder import Session
from tinygc.library.arguments import Progress, answers_of, is_path, nothing, public
from tinygc.library.logs import asking_for_keywords


@public(Answers)
def verify(
    model: Path | str,
    today: Any,
    *,
    false_alarm: float = 0.05,
    limit_deg: float = 1.0,
    history: Sequence[Path | str] = (),
    lot: Path | str | None = None,
    switched_on: bool = True,
    elapsed_s: float | None = None,
    noise: Path | str | None = None,
    other_serial: bool = False,
    earth: bool = True,
    serial: str = "",
    progress: Progress | None = None,
    **answers: Any,
) -> Any:
    """Say whether a stored calibration still holds, and if not, why, what that costs, and what to do.

    Parameters
    ----------
    model : str or Path
        A model file, or a fitted session folder.
    today : Session, str or Path
        A session, its folder, or a log of any program: with rests and turns, or a minute at rest.
    false_alarm : float, optional
        Probability of any false alarm, over all questions.
    limit_deg : float, optional
        Degrees that a minute of use may miss before a change matters.
    history : sequence of str or Path, optional
        Two or more other fitted sessions of this unit: they show how it moves between sessions.
    lot : str or Path, optional
        File of a production lot that shows it.
    switched_on : bool, optional
        Whether the sensor may have been switched off since the calibration.
    elapsed_s : float, optional
        How long ago that was, s, where it was not switched off.
    noise : str or Path, optional
        Noise figures of the unit, ``noise.json``: its drift in that time.
    other_serial : bool, optional
        Whether to go on with a recording of another serial number.
    earth : bool, optional
        Whether the Earth's rotation is taken out of the rates.
    serial : str, optional
        Serial number of the sensor of a log.
    progress : callable, optional
        Called with what is done, how far, and of how much.
    **answers
        What a log does not say, as of ``tinygc.import_log``: ``gyro_fs_dps=500``, ``gyro_unit="dps"``, ``odr_hz=100`` and others.

    Returns
    -------
    Verified
        ``answer``, ``headline``, ``exit_code``, ``bias_dps``, ``result``, ``summary()``, ``to_json()``, ``save_model(path)``.

    Raises
    ------
    CalibrationError
        For what cannot be read or compared, and if the verification feature was removed; its message is one line.

    Examples
    --------
    >>> import tempfile, tinygc
    >>> from pathlib import Path
    >>> folder = Path(tempfile.mkdtemp())
    >>> unit = {"closure_s": 0.0, "odr_hz": 104.0, "unit_seed": 1}
    >>> then = tinygc.fit(tinygc.simulate(segments=14, seed=1, **unit).session, methods=("least_squares",))
    >>> model = then.save(folder) / "model_least_squares.json"
    >>> tinygc.verify(model, tinygc.simulate(segments=10, seed=2, **unit).session).answer
    'holds'

    """
    feature = need("verification of a calibration")
    for name, value, most in (("false_alarm", false_alarm, 1.0), ("limit_deg", limit_deg, 180.0)):
        if not 0 < value < most:
            raise CalibrationError(f"verify: {name} is {value:g}, expected a number between 0 and {most:g}")
    if not isinstance(today, Session) and not is_path(today):
        raise CalibrationError(f"today is of type {type(today).__name__}, expected a tinygc.Session, a session folder or a log")
    options = feature.Options(
        false_alarm=false_alarm,
        limit_deg=limit_deg,
        history=tuple(map(Path, history)),
        lot=None if lot is None else Path(lot),
        switched_on=switched_on,
        elapsed_s=elapsed_s,
        noise=None if noise is None else Path(noise),
        other_serial=other_serial,
        earth=earth,
    )
    given = today if isinstance(today, Session) else Path(today)
    with asking_for_keywords():
        return feature.verify_of(Path(model), given, options, answers_of(answers), serial, progress or nothing)
