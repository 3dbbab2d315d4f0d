"""A truth file as it comes: its clock, its world, inverse quaternions, another mounting, each put in and found again."""

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG, broad
from scipy.linalg import polar
from scipy.spatial.transform import Rotation
from truth_sessions import Wrong, made, write

import calibrate
from session.detect.check_references import with_aligned_truth
from session.detect.first_look import check_folder
from session.detect.truth_alignment import align
from session.io.config import FRAMES, ORDERS, SENSES, TruthGiven, TruthReading, down_of, read_config
from session.io.errors import FormatError
from session.io.logfile import read_truth

MILLI = 1e-3


def matrix_of(q):
    return Rotation.from_quat(q, scalar_first=True).as_matrix()


def apart_deg(one, other):
    """Between attitudes (K, 4), a turn about the vertical taken off."""
    between = Rotation.from_quat(one, scalar_first=True) * Rotation.from_quat(other, scalar_first=True).inv()
    yaw = Rotation.from_euler("z", np.median(between.as_euler("zyx")[:, 0]))
    return float(np.degrees((yaw.inv() * between).magnitude().max()))


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("sense", SENSES)
@pytest.mark.parametrize("frame", FRAMES)
def test_what_is_written_is_read_and_written_again(order, sense, frame):
    q = Rotation.random(20, random_state=1).as_quat(scalar_first=True)
    reading = TruthReading(order, sense, frame, Rotation.random(random_state=2).as_matrix(), 0.1)
    assert np.abs(np.abs(np.sum(reading.read(reading.written(q)) * q, axis=1)) - 1).max() < 1e-14
    # By matrices: the file's world has its down where the frame says, and the mounting is on the body's side.
    body_to_world = reading.written(q) if order == "wxyz" else np.roll(reading.written(q), 1, axis=1)
    body_to_world = matrix_of(body_to_world) if sense == "body_to_world" else matrix_of(body_to_world).transpose(0, 2, 1)
    down = np.einsum("kij,jl,kl->ki", body_to_world, reading.mounting, matrix_of(q)[:, 2, :])
    assert np.abs(down - down_of(frame)).max() < 1e-12
    assert abs(down_of(frame) @ (np.eye(3)["xyz".index(frame[0])] if frame[1] == "_" else [0, 0, 1])) == pytest.approx(1)


@pytest.mark.parametrize(
    ("wrong", "found"),
    [
        (Wrong(), {}),
        (Wrong(order="xyzw", frame="enu", late_s=-0.004), {"order", "offset_s"}),
        broad(Wrong(late_s=1.5), {"offset_s"}),
        broad(Wrong(mounting_deg=(180, 0, 0), frame="enu"), {"mounting"}),
        (Wrong(mounting_deg=(0, 0, 90), sense="world_to_body", frame="enu", late_s=0.02), {"sense", "mounting", "offset_s"}),
    ],
)
def test_each_is_found_and_nothing_else(wrong, found):
    session, E = made(wrong)
    aligned = align(session)
    alignment = aligned.alignment
    reading, source = alignment.reading, alignment.source
    assert {name for name in ("offset_s", "sense", "order", "mounting") if source[name] == "found"} == set(found)
    assert (reading.frame, reading.sense, reading.order) == (wrong.frame, wrong.sense, wrong.order)
    assert abs(alignment.offset_s + wrong.late_s) < 4 * alignment.offset_sigma_s < 0.3 * MILLI
    # The gyro's own common misalignment is in the mounting: its matrix is a rotation times what is symmetric.
    own = Rotation.from_rotvec(np.multiply(wrong.mounting_deg, DEG)).as_matrix() @ polar(E)[0]
    left = (Rotation.from_matrix(own).inv() * Rotation.from_rotvec(alignment.turned)).as_rotvec()
    assert np.abs(left / alignment.turned_sigma).max() < 4.5
    assert alignment.turned_sigma.max() < 0.02 * DEG
    # What comes out are the attitudes that there were.
    (truth,), (plain,) = aligned.truths, made(replace(wrong, frame="ned", sense="body_to_world", order="wxyz"))[0].truths
    mounting = TruthReading(mounting=reading.mounting)
    assert apart_deg(truth.q_nb, mounting.read(plain.q_nb)) < 1e-4


def test_an_inverse_in_another_order_is_a_mounting_and_comes_to_the_same():
    """(x, y, z, w) of an inverse is a turned attitude, exactly: no recording tells the two apart, and no calibration minds."""
    session, _ = made(Wrong(order="xyzw", sense="world_to_body"))
    (truth,), (plain,) = align(session).truths, made(Wrong())[0].truths
    assert apart_deg(truth.q_nb, plain.q_nb) < 1.0  # the gyro's own misalignment is in the mounting


def test_without_an_accelerometer_rates_alone_tell_the_sense():
    alignment = align(made(Wrong(sense="world_to_body", force=False))[0]).alignment
    assert (alignment.source["sense"], alignment.source["frame"], alignment.up) == ("found", "assumed", None)


def test_turns_about_one_axis_do_not_make_an_inverse_of_a_truth():
    """About z alone, an inverse and half a turn of mounting are the same motion: the contract's own way stands."""
    alignment = align(made(Wrong(axis=(0, 0, 1), misaligned=0.0))[0]).alignment
    assert {name for name, source in alignment.source.items() if source == "found"} <= {"frame"}


def test_a_truth_of_another_recording_is_left_as_it_is():
    session, other = made(Wrong(), seed=1)[0], made(Wrong(), seed=2)[0]
    mixed = align(replace(session, truths=other.truths))
    assert not np.isfinite(mixed.alignment.offset_s)
    np.testing.assert_allclose(mixed.truths[0].q_nb, other.truths[0].q_nb, atol=1e-15)
    assert set(mixed.alignment.source.values()) == {"assumed"}


def test_what_is_given_is_used_and_held_against_the_recording():
    right = TruthGiven(offset_s=-0.004, frame="enu", sense="world_to_body", mounting=Rotation.from_rotvec([0, 90 * DEG, 0]).as_matrix())
    wrong = Wrong(late_s=0.004, frame="enu", sense="world_to_body", mounting_deg=(0, 90, 0), given=right)
    session, findings = with_aligned_truth(made(wrong)[0])
    assert {finding.level for finding in findings} == {"ok"}
    assert set(session.alignment.source.values()) == {"given", "assumed"}
    assert session.alignment.reading.offset_s == -0.004
    turned = Rotation.from_rotvec([0, 80 * DEG, 0]).as_matrix()
    for name, what, value in (("offset_s", "clock", 0.0), ("frame", "frame", "ned"), ("mounting", "mounting", turned)):
        session, findings = with_aligned_truth(made(replace(wrong, given=replace(right, **{name: value})))[0])
        assert [finding.what for finding in findings if finding.level == "warning"] == [f"truth's {what}"]
    assert abs(session.alignment.offset_s + 0.004) < 4 * session.alignment.offset_sigma_s


def on_another_clock(wrong, later_s, given):
    """A session whose truth has stamps that are later by so many seconds, more than any search would reach."""
    session, _ = made(wrong)
    (truth,) = session.truths
    moved = replace(truth, t_ns=truth.t_ns + round(later_s * 1e9)).reread(TruthReading(), TruthReading.of(given))
    return replace(session, truths=(moved,), config=replace(session.config, truth=given))


def test_a_given_clock_is_held_against_the_recording_wherever_it_is():
    """Off by a second: said, and the frame found all the same; by a minute: nothing tells the frame, and not for want of gravity."""
    wrong = Wrong(frame="enu")
    session, findings = with_aligned_truth(on_another_clock(wrong, 100.0, TruthGiven(offset_s=-101.0)))
    assert {finding.what for finding in findings if finding.level == "warning"} == {"truth's clock"}
    assert abs(session.alignment.offset_s + 100) < 4 * session.alignment.offset_sigma_s
    assert session.alignment.reading.frame == "enu"
    session, findings = with_aligned_truth(on_another_clock(wrong, 100.0, TruthGiven(offset_s=-160.0)))
    said = {finding.what: finding for finding in findings}
    assert session.alignment.source["frame"] == "assumed"
    assert "do not go together" in said["truth's frame"].says
    assert "no specific force" not in said["truth's frame"].says
    assert said["truth's clock"].level == "note"


def test_the_page_of_a_check_says_all_of_it_and_files_need_no_truth_section(tmp_path):
    folder = write(tmp_path, Wrong(late_s=0.00406, sense="world_to_body", frame="enu", mounting_deg=(0, 0, 90)))
    said = {finding.what: finding for finding in check_folder(folder) if finding.what.startswith("truth's")}
    assert {finding.level for finding in said.values()} == {"note"}
    assert "late" in said["truth's clock"].says
    assert "z up (found)" in said["truth's frame"].says
    assert "inverse" in said["truth's attitudes"].says
    assert "taken off" in said["truth's mounting"].says
    # What to keep is written so that it can be kept.
    keeps = [finding.do.split(" in session.toml")[0].removeprefix("truth.") for finding in said.values()]
    with (folder / "session.toml").open("a") as file:
        file.write("[truth]\n" + "\n".join(keeps) + "\n")
    again = {finding.what: finding for finding in check_folder(folder) if finding.what.startswith("truth's")}
    assert {finding.level for finding in again.values()} == {"ok"}


def test_fit_and_explain_put_it_into_their_json(tmp_path, capsys):
    folder = write(tmp_path, Wrong(late_s=0.00406, frame="enu", turns=12))
    words = ["fit", str(folder), "--methods", "least_squares", "--verbose", "--json", str(tmp_path / "fit.json")]
    assert calibrate.main(words) == 0
    told = json.loads((tmp_path / "fit.json").read_text())["truth"]
    assert told["source"] == {"offset": "found", "frame": "found", "sense": "assumed", "order": "assumed", "mounting": "assumed"}
    assert told["offset_used_s"] == told["offset_s"] == pytest.approx(-0.00406, abs=4 * told["offset_std_s"])
    assert told["frame"] == "enu"
    assert "added to its stamps" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('frame = "up"', "truth.frame"),
        ('sense = "inverse"', "truth.sense"),
        ("order = 4", "truth.order"),
        ("offset_s = 1e9", "truth.offset_s"),
        ("mounting = [[1, 0, 0], [0, 1, 0], [0, 0, -1]]", "truth.mounting is no rotation"),
        ("mounting = [[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]", "truth.mounting is no rotation"),
        ("mounting = [1, 0, 0]", "truth.mounting"),
    ],
)
def test_what_cannot_be_meant_is_one_line(tmp_path, text, says):
    path = tmp_path / "session.toml"
    path.write_text(f'schema = "tinygc-session/1"\n[sensor]\nodr_hz = 100\ngyro_fs_dps = 500\naccel_fs_g = 4\n[truth]\n{text}\n')
    with pytest.raises(FormatError, match=says):
        read_config(path)


def test_a_header_may_have_the_scalar_last(tmp_path):
    path = tmp_path / "truth0001.csv"
    path.write_text("t_s,qx,qy,qz,qw\n0,0.6,0,0,0.8\n1,0,0.6,0,0.8\n")
    np.testing.assert_allclose(read_truth(path).q_nb, [[0.8, 0.6, 0, 0], [0.8, 0, 0.6, 0]])
