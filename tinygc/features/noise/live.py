"""How long a rest is enough, while it is recorded (``noise record``): ``session.bench.rest_guide.RestFigures`` over the estimate.

The estimate runs in a thread of its own, on a copy of the sums, since a recording must not wait for it.  It is repeated each minute at
first, then whenever the rest is a tenth longer, and never takes more than a tenth of the time.
"""

from __future__ import annotations

import copy
import threading
import time

import numpy as np

from session.base.errors import CalibrationError
from session.base.texts import significant
from session.base.units import NS
from session.bench.rest_guide import RestAnswer, in_words
from session.log.samples import Samples, joined
from tinygc.features.noise.estimate import estimate_noise, known_after_s
from tinygc.features.noise.output import ONE_SIDED
from tinygc.features.noise.summary import RestSums
from tinygc.noise.figures import SENSORS, NoiseFigures
from tinygc.noise.measured import SHOWN, WALKS

#: of samples, whose stamps give the data rate; of samples that are added at once
RATE_S, PIECE_S = 2.0, 1.0
#: of rest between two estimates, and its share of the whole rest; of the time that estimates may take
EVERY_S, LATER, SHARE = 60.0, 0.1, 0.1
#: of a log that counts: a board that resets again and again would make thousands of short ones
SHORTEST_S = 60.0


class LiveNoise:
    """Figures of the rest so far.  relative: sigma over value, to which N, and B or K, are required."""

    def __init__(self, relative: float) -> None:
        self._relative = relative
        self._waiting: list[Samples] = []  # not added yet: the guide's blocks of 0.1 s are short for that
        self._logs: list[tuple[RestSums, float]] = []  # of earlier logs, with their durations
        self._sums: RestSums | None = None
        self._here_s = 0.0
        self._next_s, self._next_at = EVERY_S, 0.0  # of rest, and of this computer's clock
        self._thread: threading.Thread | None = None
        self._found: RestAnswer | None = None
        self._reported: RestAnswer | None = None
        self._failed = False

    @property
    def rested_s(self) -> float:
        """The rest so far."""
        return self._here_s + sum(seconds for _, seconds in self._logs)

    def add(self, samples: Samples) -> None:
        """Take the next samples of the present log, SI."""
        if self._failed or not len(samples):
            return
        try:
            self._add(samples)
        except Exception as error:
            self._fail(error)

    def _add(self, samples: Samples) -> None:
        self._waiting.append(samples)
        if (samples.t_ns[-1] - self._waiting[0].t_ns[0]) * NS < (RATE_S if self._sums is None else PIECE_S):
            return
        piece, self._waiting = joined(self._waiting), []
        if self._sums is None:
            self._sums = RestSums((len(piece) - 1) / piece.duration_s)
        self._sums.add(piece)
        self._here_s += len(piece) / self._sums.rate_hz

    def new_log(self) -> None:
        """The samples that follow do not continue those before."""
        if self._sums is not None and self._here_s >= SHORTEST_S:
            self._logs.append((self._sums, self._here_s))
        self._sums, self._waiting, self._here_s = None, [], 0.0

    def answer(self) -> RestAnswer | None:
        """Return a new answer; None where nothing has changed.  Starts the next estimate where it is due."""
        if self._thread is not None and self._thread.is_alive():
            return None
        self._thread, new = None, self._found if self._found != self._reported else None
        if new is not None:
            self._reported = new
            return new
        rested_s = self.rested_s
        if self._failed or rested_s < self._next_s or time.monotonic() < self._next_at:
            return None
        self._next_s = rested_s + max(EVERY_S, LATER * rested_s)
        try:
            sums = copy.deepcopy([each for each, _ in self._logs] + ([] if self._sums is None else [self._sums]))
        except Exception as error:
            self._fail(error)
            return None
        # A daemon: an estimate in progress must not keep a recording from its end.
        self._thread = threading.Thread(target=self._run, args=(sums, rested_s), name="noise", daemon=True)
        self._thread.start()
        return None

    def _run(self, sums: list[RestSums], rested_s: float) -> None:
        began_s = time.monotonic()
        try:
            self._found = answer_of(estimate_noise(sums).figures, rested_s, self._relative)
        except CalibrationError as error:  # too short a rest, as a rule
            self._found = RestAnswer((f"no noise figures yet: {error}",))
        except Exception as error:
            self._fail(error)
        now_s = time.monotonic()
        self._next_at = now_s + (now_s - began_s) / SHARE

    def _fail(self, error: Exception) -> None:
        """No failure of the figures may end a recording."""
        self._failed = True
        self._found = RestAnswer((f"the noise figures have failed ({type(error).__name__}: {error}); the rest is recorded without them",))


def answer_of(figures: NoiseFigures, rested_s: float, relative: float) -> RestAnswer:
    """What figures (rested_s s of rest) show of each sensor, and when N, and B or K, are known to a relative sigma.

    N must be known on each axis, and so must each of G, B and K whose size is a number there.  Where none is, B or K is awaited, whichever
    its limit allows to be known first, since no noise has a bias that stays for ever.
    """
    lines, known = [], True
    for kind, sensor in figures.sensors().items():
        waits: dict[str, float] = {}
        hidden = {"B or K"}  # of which there are limits alone: they may be smaller, and known later
        for number, axis in enumerate(sensor.axes):

            def wait_s(name: str, kind: str = kind, number: int = number) -> float:
                term = figures.sensors()[kind].axes[number].terms[name]
                if term.is_known(relative):
                    return 0.0
                return max(known_after_s(figures, kind, number, name, relative), rested_s)

            shown = [name for name in WALKS if axis.terms[name].is_determined]
            for name in ("N", *shown):
                waits[name] = max(waits.get(name, 0.0), wait_s(name))
            if not axis.terms["N"].is_determined:
                hidden.add("N")
            if not shown:
                waits["B or K"] = max(waits.get("B or K", 0.0), min(wait_s(name) for name in ("B", "K")))
        done = [name for name, seconds in waits.items() if seconds == 0]
        parts = [f"{' and '.join(done)} known to {100 * relative:g} %"] if done else []
        parts += [
            f"{name} will not be, however long it rests"
            if not np.isfinite(seconds)
            else f"{name} {'not before' if name in hidden else 'will be after'} {in_words(seconds)}"
            for name, seconds in waits.items()
            if seconds > 0
        ]
        known = known and not any(waits.values())
        lines.append(f"{in_words(rested_s)}, {SENSORS[kind]}: {'; '.join(parts)}")
        lines.append(f"{SENSORS[kind]}: {', '.join(_value(figures, kind, name) for name in ('N', 'B', 'K'))} (worst axis)")
    return RestAnswer(tuple(lines), known)


def _value(figures: NoiseFigures, kind: str, name: str) -> str:
    """A term of the worst axis, ``N 5.1 mdps/√Hz``, or its limit where that is larger."""
    unit, si = ONE_SIDED[kind] if name == "N" else SHOWN[kind][name]
    terms = [axis.terms[name] for axis in figures.sensors()[kind].axes]
    value = max((term.value for term in terms if term.is_determined), default=0.0)
    limit = max((np.inf if term.at_most is None else term.at_most for term in terms if not term.is_determined), default=0.0)
    if value >= limit:
        return f"{name} {significant(value / si)} {unit}"
    return f"{name} ?" if np.isinf(limit) else f"{name} < {significant(limit / si, 2)} {unit}"
