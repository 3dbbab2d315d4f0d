"""Draw the tables, their turns and the wiring for docs/table.md and docs/wiring.md: python docs/make_drawings.py

Each drawing is one SVG of lines and text.  Solids are drawn in parallel projection, in millimetres: x to the lower right, y to the upper
right, z up.  The forty turns are searched, not listed: each is the one that adds most information to those before it.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

import numpy as np

DOCS = Path(__file__).resolve().parent
sys.path.insert(0, str(DOCS.parent))

from session.base import rotation  # noqa: E402
from session.base.units import DEG  # noqa: E402
from tinygc.planning.turns import STILL_S, Turn, columns, turns_from, up_words  # noqa: E402

COS, SIN = np.cos(30 * DEG), np.sin(30 * DEG)
INK, SOFT, ACCENT, PAPER = "#1c2733", "#5b6b7a", "#c2410c", "#ffffff"
WOOD, METAL, BOARD, RUBBER = (
    ("#f3e3c8", "#e3cda4", "#d3b98a"),
    ("#eef1f4", "#d4dae0", "#b9c2cb"),
    ("#2f7d5b", "#24634a", "#1b4d39"),
    ("#59636e",) * 3,
)
FONT = 'font-family="system-ui,Segoe UI,Helvetica,Arial,sans-serif"'
Point = tuple[float, float]


class Drawing:
    """Shapes of one SVG, in its units (px)."""

    def __init__(self, width: int, height: int, title: str, origin: Point = (0, 0), scale: float = 1.0) -> None:
        """origin: where (0, 0, 0) mm lies; scale: px a mm."""
        self.width, self.height, self.title, self.origin, self.scale = width, height, title, origin, scale
        self.shapes: list[str] = []

    def at(self, x: float, y: float, z: float) -> Point:
        """Where a point of space is drawn."""
        return (self.origin[0] + self.scale * COS * (x + y), self.origin[1] + self.scale * (SIN * (x - y) - z))

    def polygon(self, points: Iterable[Point], fill: str, stroke: str = INK, width: float = 1.0, closed: bool = True) -> None:
        """A filled outline, or a line."""
        path = "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
        self.shapes.append(
            f'<path d="M{path}{"Z" if closed else ""}" fill="{fill}" stroke="{stroke}" stroke-width="{width}" stroke-linejoin="round"/>'
        )

    def line(self, points: Iterable[Point], stroke: str = INK, width: float = 1.2, arrow: bool = False, dash: str = "") -> None:
        """A line through points of the drawing."""
        path = "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
        marks = (' marker-end="url(#a)"' if arrow else "") + (f' stroke-dasharray="{dash}"' if dash else "")
        self.shapes.append(f'<path d="M{path}" fill="none" stroke="{stroke}" stroke-width="{width}" stroke-linejoin="round"{marks}/>')

    def text(self, x: float, y: float, text: str, size: float = 13, anchor: str = "start", fill: str = INK, bold: bool = False) -> None:
        """Text, its base line at y."""
        weight = ' font-weight="600"' if bold else ""
        self.shapes.append(
            f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size}" text-anchor="{anchor}" fill="{fill}"{weight}>{escape(text)}</text>'
        )

    def label(self, target: Point, x: float, y: float, *lines: str) -> None:
        """Text with a line to what it names; the line ends at the side of the text that is nearer."""
        left = target[0] < x
        self.line([target, (x + (-4 if left else 4), y - 4)], SOFT, 0.8)
        self.shapes.append(f'<circle cx="{target[0]:.1f}" cy="{target[1]:.1f}" r="2" fill="{SOFT}"/>')
        for number, text in enumerate(lines):
            self.text(x, y + 15 * number, text, 12.5 if number == 0 else 11.5, "start" if left else "end", INK if number == 0 else SOFT)

    def measure(self, a: Point, b: Point, text: str, dx: float = 0, dy: float = 0) -> None:
        """A dimension from a to b, its text moved by dx, dy."""
        self.line([a, b], SOFT, 0.9)
        n = np.array([b[1] - a[1], a[0] - b[0]]) / max(np.hypot(b[0] - a[0], b[1] - a[1]), 1e-9) * 4
        for end in (a, b):
            self.line([(end[0] - n[0], end[1] - n[1]), (end[0] + n[0], end[1] + n[1])], SOFT, 0.9)
        self.text((a[0] + b[0]) / 2 + dx, (a[1] + b[1]) / 2 + dy, text, 11.5, "middle", SOFT)

    def box(self, x: float, y: float, z: float, dx: float, dy: float, dz: float, fills: Sequence[str]) -> None:
        """A box by its corner and its sides; fills: top, left side, right side."""
        p = self.at
        self.polygon([p(x, y, z), p(x + dx, y, z), p(x + dx, y, z + dz), p(x, y, z + dz)], fills[1])
        self.polygon([p(x + dx, y, z), p(x + dx, y + dy, z), p(x + dx, y + dy, z + dz), p(x + dx, y, z + dz)], fills[2])
        self.polygon([p(x, y, z + dz), p(x + dx, y, z + dz), p(x + dx, y + dy, z + dz), p(x, y + dy, z + dz)], fills[0])

    def circle(self, centre: Sequence[float], axis: str, radius: float, start: float = 0, stop: float = 360) -> list[Point]:
        """Points of a circle about an axis, from start to stop (degrees)."""
        first, second = {"z": (0, 1), "x": (1, 2), "y": (2, 0)}[axis]
        points = []
        for angle in np.linspace(start * DEG, stop * DEG, 73):
            place = np.array(centre, dtype=float)
            place[first] += radius * np.cos(angle)
            place[second] += radius * np.sin(angle)
            points.append(self.at(*place))
        return points

    def cylinder(self, centre: Sequence[float], radius: float, height: float, fills: Sequence[str]) -> None:
        """A cylinder that stands at a centre."""
        x, y, z = centre
        base, top = self.circle(centre, "z", radius), self.circle((x, y, z + height), "z", radius)
        middle = self.at(*centre)[1]
        lower = sorted((point for point in base if point[1] >= middle - 0.01), key=lambda point: point[0])  # the half that faces the reader
        upper = [(lower[-1][0], lower[-1][1] - self.scale * height), (lower[0][0], lower[0][1] - self.scale * height)]
        self.polygon([*lower, *upper], fills[1])
        self.polygon(top, fills[0])

    def board(self, x: float, y: float, z: float, size: float = 26) -> None:
        """A sensor's board with its three axes."""
        self.box(x, y, z, size, size * 0.7, 2, BOARD)
        chip = size * 0.22
        self.box(x + size * 0.4, y + size * 0.25, z + 2, chip, chip, 2, RUBBER)
        origin = (x + size * 0.5, y + size * 0.35, z + 4)
        for name, step in (("x", (size * 0.9, 0, 0)), ("y", (0, size * 0.9, 0)), ("z", (0, 0, size * 0.8))):
            end = self.at(*np.add(origin, step))
            self.line([self.at(*origin), end], ACCENT, 1.6, arrow=True)
            past = self.at(*np.add(origin, np.multiply(step, 1.35)))
            self.text(past[0], past[1] + 4, name, 12, "middle", ACCENT, True)

    def save(self, name: str) -> None:
        """Write it."""
        head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {self.width} {self.height}" width="{self.width}" role="img" {FONT}>'
        tip = f'<path d="M0 0L8 4L0 8Z" fill="{ACCENT}"/>'
        arrow = f'<marker id="a" viewBox="0 0 8 8" refX="6" refY="4" markerWidth="6" markerHeight="6" orient="auto">{tip}</marker>'
        paper = f'<rect width="{self.width}" height="{self.height}" rx="6" fill="{PAPER}"/>'
        lines = [head, f"<title>{escape(self.title)}</title>", f"<defs>{arrow}</defs>", paper, *self.shapes, "</svg>", ""]
        (DOCS / name).write_text("\n".join(lines), encoding="utf-8")


# What a table that is turned by hand can be.


def cube() -> None:
    """A cube that is rolled from face to face in a corner of three plates."""
    d = Drawing(900, 420, "A cube in a corner", (120, 235), 1.55)
    d.box(-10, 100, 0, 140, 12, 75, WOOD)  # wall behind, to the right
    d.box(-22, -20, 0, 12, 132, 75, WOOD)  # wall behind, to the left
    d.box(-10, -20, -12, 140, 120, 12, WOOD)  # floor
    d.box(0, 20, 0, 70, 70, 70, METAL)
    d.board(20, 42, 70, 30)
    d.measure(d.at(0, 12, 0), d.at(70, 12, 0), "60 to 100 mm", 50, 48)
    cable = [d.at(38, 66, 73), d.at(46, 92, 92), d.at(62, 104, 106), d.at(100, 114, 92)]
    d.line(cable, INK, 2.4)
    roll = d.circle((70, 55, 35), "y", 50, 80, 10)
    d.line(roll, ACCENT, 2, arrow=True)
    d.label(
        d.at(20, 106, 75), 560, 40, "two walls and a floor, screwed or glued", "plywood, or the corner of a shelf; square to 1° is enough"
    )
    d.label(cable[2], 560, 95, "thin cable with slack, fixed on the cube", "a stiff cable turns the cube while it should be still")
    d.label(d.at(46, 64, 73), 560, 150, "board screwed or glued on, flat", "no foam, no tape, no pin header as the only hold")
    d.label(d.at(70, 80, 50), 560, 205, "cube of wood, aluminium or a printer, faces flat", "a stiff cardboard box does as well")
    d.label(roll[60], 560, 260, "a turn: roll it by 90°, 180° or 270°", "over its edges, then push it into the corner")
    d.label(d.at(130, 70, -6), 560, 315, "the corner is the index mark", "the cube returns to it at the end of the closure run")
    d.save("table-cube.svg")


def ball() -> None:
    """A plate on the ball head of a camera's tripod."""
    d = Drawing(900, 420, "A plate on a ball joint", (190, 305), 1.5)
    d.box(-50, -50, -12, 120, 120, 12, WOOD)
    d.cylinder((10, 10, 0), 26, 40, METAL)
    middle = d.at(10, 10, 48)
    d.shapes.append(f'<circle cx="{middle[0]:.1f}" cy="{middle[1]:.1f}" r="32" fill="{RUBBER[0]}" stroke="{INK}"/>')
    d.cylinder((10, 10, 68), 9, 26, METAL)
    d.box(-30, -28, 94, 84, 76, 8, WOOD)
    d.board(-8, -2, 102, 32)
    knob = d.at(38, 6, 18)
    d.shapes.append(f'<ellipse cx="{knob[0] + 8:.1f}" cy="{knob[1] + 4:.1f}" rx="12" ry="9" fill="{RUBBER[0]}" stroke="{INK}"/>')
    mark = [(middle[0] - 14, middle[1] + 12), (middle[0] - 14, middle[1] + 34)]
    d.line(mark, "#ffffff", 3)
    d.line(mark, ACCENT, 2)
    swing = d.circle((10, 10, 58), "y", 84, 62, 14)
    d.line(swing, ACCENT, 2, arrow=True)
    d.label(d.at(54, 48, 98), 560, 60, 'plate of 100 to 150 mm, screwed on (1/4"-20)')
    d.label(swing[50], 560, 110, "turns of 60° to 90° in both senses", "about two level axes; swivel in between")
    d.label((middle[0] + 26, middle[1] - 6), 560, 170, "ball head of a tripod", "tilts by 90° to one side, swivels without end")
    d.label((knob[0] + 18, knob[1] + 4), 560, 230, "clamp it for each still, release it for the turn")
    d.label(mark[1], 560, 280, "index mark: a line across ball and socket", "back on it at the end of the closure run")
    d.label(d.at(70, 30, -6), 560, 340, "base screwed to a bench or to a heavy board", "it must not rock when you let go")
    d.save("table-ball.svg")


def gimbal() -> None:
    """Three nested frames, as a camera's gimbal with its motors off."""
    d = Drawing(900, 440, "Three nested frames", (240, 240), 1.3)
    d.box(-100, -16, -96, 200, 32, 10, WOOD)
    d.box(-102, -8, -86, 10, 16, 96, WOOD)
    for axis, radius, width, colour in (("y", 80, 7, METAL[2]), ("x", 62, 6, WOOD[2])):
        d.line(d.circle((0, 0, 0), axis, radius), INK, width + 2)
        d.line(d.circle((0, 0, 0), axis, radius), colour, width)
    d.box(-32, -26, -4, 64, 52, 5, WOOD)
    d.board(-12, -9, 1, 22)
    d.box(92, -8, -86, 10, 16, 96, WOOD)
    for side in (-1, 1):
        d.line([d.at(side * 80, 0, 0), d.at(side * 95, 0, 0)], INK, 5)
    d.line(d.circle((0, 0, 0), "z", 46, -50, 40), ACCENT, 2, arrow=True)
    spin = d.circle((112, 0, 0), "x", 22, 200, 20)
    d.line(spin, ACCENT, 2, arrow=True)
    d.label(d.circle((0, 0, 0), "y", 80)[9], 560, 50, "outer frame: turns about the level axis of the posts")
    d.label(d.circle((0, 0, 0), "x", 62)[14], 560, 95, "middle frame: turns in the outer frame")
    d.label(d.at(32, 20, -2), 560, 140, "plate: turns in the middle frame, by 360° and more")
    d.label(d.at(95, 0, 0), 560, 190, "bearings: skateboard's 608, or screws in wood", "a felt washer keeps each frame where you leave it")
    d.label(spin[50], 560, 245, "turns of 90° to 360° about each axis", "one frame at a time, or two at once")
    d.label(d.at(97, 8, -50), 560, 300, "index marks: a pin through frame and post", "back on all of them at the end of the closure run")
    d.label(d.at(100, 16, -91), 560, 355, "posts 200 mm apart, base screwed down")
    d.text(560, 410, "A camera gimbal with its motors off is the same table.", 12, fill=SOFT)
    d.save("table-gimbal.svg")


# The forty turns.


def best_turns(count: int) -> tuple[list[tuple[np.ndarray, Turn]], np.ndarray]:
    """The turns of a cube, each from where the last one ended and the most informative there, and the forecast sigma (12,) of a sensor with
    5 mdps/√Hz and 60 µg/√Hz: E (9) in row order, then B (rad/s)."""
    noise_rad = np.hypot(5e-3 * DEG / np.sqrt(2) * np.sqrt(5.0), np.sqrt(2) * 60e-6 / np.sqrt(2) / np.sqrt(STILL_S))
    prior = np.array([0.02] * 9 + [2 * DEG] * 3)
    information, up, chosen = np.diag(1 / prior**2), np.array([0.0, 0.0, 1.0]), []
    used: dict[str, int] = {}
    for _ in range(count):
        # a turn about the vertical ends as it began; a whole turn is not a roll from face to face
        turns = [
            turn for turn in turns_from(up) if len(turn.parts) == 1 and abs(turn.parts[0].axis @ up) < 0.1 and turn.parts[0].angle_rad < 5
        ]
        rows = columns(up, turns) / noise_rad
        gains = [np.linalg.slogdet(information + J.T @ J)[1] - 0.02 * used.get(turn.words, 0) for turn, J in zip(turns, rows, strict=True)]
        best = int(np.argmax(gains))
        information = information + rows[best].T @ rows[best]
        chosen.append((up, turns[best]))
        used[turns[best].words] = used.get(turns[best].words, 0) + 1
        up = turns[best].parts[-1].up
    return chosen, np.sqrt(np.diag(np.linalg.inv(information)))


def small_cube(d: Drawing, x: float, y: float, q_tb: np.ndarray, size: float, strong: bool) -> None:
    """A cube whose faces bear the axes' letters, drawn as it lies; q_tb: from board to table."""
    R = np.diag([1.0, -1.0, -1.0]) @ rotation.matrix(q_tb)  # the table's z points down (docs/formats.md), the drawing's up
    across, down = np.array([COS, COS, 0.0]), np.array([SIN, -SIN, -1.0])  # of the drawing's x, y, z
    eye = np.array([1.0, -1.0, 1.0])
    for axis in range(3):
        for sign in (1.0, -1.0):
            normal = sign * R[:, axis]
            if normal @ eye <= 0.1:
                continue
            a, b = R[:, (axis + 1) % 3], R[:, (axis + 2) % 3]
            corners = [normal + i * a + j * b for i, j in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
            d.polygon(
                [(x + size * across @ corner, y + size * down @ corner) for corner in corners],
                ("#dbeafe", "#fde68a", "#bbf7d0")[axis] if strong else "#f4f6f8",
                SOFT if not strong else INK,
                0.8,
            )
            letter, ink = ("−" if sign < 0 else "") + "xyz"[axis], INK if strong else SOFT
            d.text(x + size * across @ normal, y + size * down @ normal + 3.5, letter, 10, "middle", ink, strong)


def forty() -> None:
    """Each turn as two cubes."""
    chosen, sigma = best_turns(40)
    d = Drawing(900, 900, "Forty turns of a cube, from face to face")
    q = rotation.from_gravity(np.array([0.0, 0.0, 1.0]))
    for number, (_, turn) in enumerate(chosen):
        column, row = number % 5, number // 5
        x, y = 14 + 176 * column, 12 + 110 * row
        part = turn.parts[0]
        after = rotation.multiply(q, rotation.exp(part.axis * part.angle_rad))
        small_cube(d, x + 38, y + 46, q, 17, False)
        small_cube(d, x + 120, y + 46, after, 17, True)
        d.line([(x + 68, y + 46), (x + 90, y + 46)], ACCENT, 1.8, arrow=True)
        axis = "xyz"[int(np.argmax(np.abs(part.axis)))]
        sense = "+" if part.axis.sum() > 0 else "−"
        d.text(x + 4, y + 14, str(number + 1), 12, "start", SOFT, True)
        d.text(x + 79, y + 98, f"{part.angle_rad / DEG:.0f}° about {sense}{axis}, {up_words(part.up)} up".replace("-", "−"), 11.5, "middle")
        q = after
    d.save("table-turns.svg")
    ppm, mrad, mdps = sigma[[0, 4, 8]] * 1e6, sigma[[1, 2, 3, 5, 6, 7]] * 1e3, sigma[9:] / DEG * 1e3
    print(f"forecast of the forty turns: scale {ppm.max():.0f} ppm, misalignment {mrad.max():.3f} mrad, bias {mdps.max():.2f} mdps")


# A table with a stepper.


def stepper() -> None:
    """One axis with motor, belt and bearing."""
    d = Drawing(1000, 470, "A table that a stepper motor turns", (165, 200), 1.25)
    d.box(-70, -70, -14, 330, 140, 14, WOOD)
    d.cylinder((0, 0, 0), 44, 20, METAL)  # bearing
    d.cylinder((0, 0, 20), 52, 8, RUBBER)  # large pulley
    d.box(165, -22, -10, 44, 44, 10, METAL)
    d.cylinder((187, 0, 0), 6, 20, METAL)
    d.cylinder((187, 0, 20), 15, 8, RUBBER)
    for sign in (1, -1):
        d.line([d.at(-8, sign * 52, 24), d.at(187, sign * 15, 24)], INK, 3)
    d.cylinder((0, 0, 28), 10, 24, METAL)
    d.box(76, -30, 0, 10, 10, 44, RUBBER)  # switch
    d.line([d.at(58, -20, 54), d.at(78, -24, 44)], ACCENT, 3)
    d.cylinder((0, 0, 52), 62, 6, WOOD)
    d.board(-16, -12, 58, 34)
    weight = (-48, 20, 58)
    d.box(*weight, 16, 16, 10, METAL)
    loop = [d.at(10, 8, 62), d.at(8, 40, 84), d.at(-10, 70, 84), d.at(-40, 96, 40), d.at(-50, 70, 0)]
    d.line(loop, INK, 2.2)
    d.line(d.circle((0, 0, 55), "z", 76, 195, 275), ACCENT, 2, arrow=True)
    d.label(d.at(*np.add(weight, (16, 10, 8))), 620, 40, "a weight balances board and cable", "released, the plate stays where it is")
    d.label(loop[2], 620, 95, "cable loop from above, slack for a turn each way", "the limits of the plan keep it: −361° to −1°")
    d.label(d.at(60, 10, 54), 620, 150, "plate of 120 mm on the shaft")
    d.label(
        d.at(187, 12, 24), 620, 195, "pulley of 20 teeth; belt GT2; 60 teeth below the plate", "no play; steps of 0.0375° at 16 microsteps"
    )
    d.label(
        d.at(209, 10, -5),
        620,
        250,
        "stepper NEMA 17, 1.8°, 0.4 N m, on a slotted plate",
        "a low holding current: a warm motor warms the sensor",
    )
    d.label(d.at(81, -28, 44), 620, 320, "index switch: a light barrier, and a flag on the plate", "the zero after each restart")
    d.label(d.at(28, -34, 8), 620, 375, "turntable bearing of 100 mm, or two 6806 on a tube", "no wobble that a finger feels")
    d.label(d.at(200, -70, -7), 620, 430, "heavy base, levelled to 1°", "tilt the whole by 90° for the other axes of the sensor")
    d.save("table-stepper.svg")


# Wiring: two columns of pins and the wires between them.

RED, BLACK, BLUE, GREEN, ORANGE, VIOLET = "#c81e1e", "#111827", "#1d4ed8", "#15803d", "#c2410c", "#7e22ce"


def wiring(name: str, title: str, left: str, right: str, wires: Sequence[tuple[str, str, str, str]], notes: Sequence[str]) -> None:
    """A board at the left, a sensor at the right; wires: pin of the board, pin of the sensor, colour, remark."""
    pitch, top = 34, 70
    height = top + pitch * len(wires) + 40 + 18 * len(notes)
    d = Drawing(720, height, title)
    bottom = top + pitch * len(wires) - 4
    for x, label, fill in ((30, left, "#1f4e79"), (510, right, BOARD[0])):
        d.shapes.append(f'<rect x="{x}" y="30" width="180" height="{bottom - 18}" rx="8" fill="{fill}"/>')
        d.text(x + 90, 52, label, 14, "middle", PAPER, True)
    for number, (pin, goes, colour, remark) in enumerate(wires):
        y = top + 14 + pitch * number
        d.line([(210, y), (510, y)], colour, 3)
        for x, text, anchor, shift in ((210, pin, "end", -14), (510, goes, "start", 14)):
            d.shapes.append(f'<circle cx="{x}" cy="{y}" r="6" fill="#f4c95d" stroke="{INK}"/>')
            d.text(x + shift, y + 4.5, text, 13, anchor, PAPER, True)
        if remark:
            d.text(360, y - 6, remark, 11, "middle", SOFT)
    for number, note in enumerate(notes):
        d.text(30, bottom + 40 + 18 * number, note, 12.5, fill=INK)
    d.save(name)


def wirings() -> None:
    """The four boards."""
    i2c = "I²C"
    wiring(
        "wiring-nano.svg",
        "Arduino Nano and MPU-6050",
        "Arduino Nano",
        "GY-521 (MPU-6050)",
        [
            ("5V", "VCC", RED, "the breakout has its own regulator"),
            ("GND", "GND", BLACK, ""),
            ("A4", "SDA", BLUE, f"{i2c} data"),
            ("A5", "SCL", GREEN, f"{i2c} clock"),
            ("GND", "AD0", BLACK, "address 0x68"),
        ],
        ["USB to the computer. A bare chip without regulator wants 3.3 V on all pins."],
    )
    wiring(
        "wiring-stm32.svg",
        "STM32F405 and ASM330LHH",
        "STM32F405",
        "ASM330LHH",
        [
            ("3.3V", "VDD, VDDIO", RED, "100 nF at each supply pin"),
            ("GND", "GND", BLACK, ""),
            ("PA4", "CS", ORANGE, "10 kΩ to 3.3 V"),
            ("PA5", "SPC (SCL)", GREEN, "SPI clock, 5.25 MHz"),
            ("PA6", "SDO", VIOLET, "data to the board"),
            ("PA7", "SDI (SDA)", BLUE, "data to the sensor"),
        ],
        [
            "To the computer: a USB-serial adapter of 3.3 V; PA9 to its RX, PA10 to its TX, GND to its GND.",
            "Wires to the sensor below 15 cm. Switch the supply off before you plug.",
        ],
    )
    breakouts = {  # supply, ground, SDA, SCL
        "esp32": ("ESP32", "ESP32 DevKit", ("3V3", "GND", "GPIO 21", "GPIO 22"), "USB to the computer. ESP32-S3 and -C3: SDA 8, SCL 9."),
        "rp2040": (
            "RP2040",
            "Raspberry Pi Pico",
            ("3V3 (36)", "GND (38)", "GP4 (6)", "GP5 (7)"),
            "USB to the computer; its port takes any baud rate. In brackets: the pin's number on the Pico.",
        ),
    }
    for name, (chip, board, (supply, ground, sda, scl), note) in breakouts.items():
        wires = [
            (supply, "VCC", RED, ""),
            (ground, "GND", BLACK, ""),
            (sda, "SDA", BLUE, f"{i2c} data"),
            (scl, "SCL", GREEN, f"{i2c} clock"),
            (supply, "CS, if any", ORANGE, f"selects {i2c}"),
            (ground, "AD0 or SDO", BLACK, "the lower address"),
        ]
        wiring(f"wiring-{name}.svg", f"{chip} and a sensor on {i2c}", board, f"IMU breakout ({i2c})", wires, [note])


if __name__ == "__main__":
    for draw in (cube, ball, gimbal, forty, stepper, wirings):
        draw()
