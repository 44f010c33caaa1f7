"""Units of recordings, said or questioned, and poses that were not seen."""

import re

import numpy as np
import pytest
import tilthex
from scipy.spatial.transform import Rotation
from test_estimate import recorded, write_csv
from test_recordings import EUROC, EUROC_POSE, FIELDS, inertial, quaternions, refused, same, table
from tilthex.recording import Recording


@pytest.fixture(scope="module")
def config():
    return tilthex.Config.default(tilthex.Vehicle.preset("tilt-hex"))


@pytest.fixture(scope="module")
def truth():
    return recorded(200)


@pytest.mark.parametrize(
    ("names", "factors"),
    [
        (("time_ms", "gyro_{}_deg_s", "acc_{}_g"), (1e3, 180 / np.pi, 1 / 9.80665)),
        (("t [us]", "omega_{} [deg/s]", "accel_{} (m/s^2)"), (1e6, 180 / np.pi, 1.0)),
        (("Timestamp", "w{}", "a{}"), (1.0, 1.0, 1.0)),
        (("stamp", "angular_velocity.{}", "linear_acceleration.{} [mg]"), (1.0, 1.0, 1e3 / 9.80665)),
    ],
)
def test_units_in_the_names_of_columns_count(tmp_path, config, truth, names, factors):
    time, gyro, force = names
    head = [time, *(gyro.format(a) for a in "xyz"), *(force.format(a) for a in "xyz")]
    imu = table(tmp_path / "imu.csv", head, inertial(truth, *factors))
    rows = np.column_stack([truth.pose_time, 1e3 * truth.position, quaternions(truth)])
    head = ["t", "x [mm]", "y [mm]", "z [mm]", "qx", "qy", "qz", "qw"]
    same(Recording.from_file(imu, config, poses=str(table(tmp_path / "p.csv", head, rows))), truth, 1e-6)


@pytest.mark.parametrize(
    ("factors", "question"),
    [
        ((1e9, 1.0, 1.0), "is it in nanoseconds?"),
        ((1.0, 3000.0, 1.0), "is it in degrees per second?"),
        ((1.0, 1.0, 1 / 9.81), "is it in g?"),
    ],
)
def test_units_that_are_not_said_are_asked_for(tmp_path, config, factors, question):
    t = np.arange(0, 2, 0.002)
    still = np.column_stack([t, 0.02 + 0 * t, 0 * t, 0 * t, 0 * t, 0 * t, 9.81 + 0 * t])
    still *= np.r_[factors[0], [factors[1]] * 3, [factors[2]] * 3]
    poses = np.tile([0, 0, 0, 0, 0, 0, 1.0], (len(t), 1))
    names = ["time", *(f"gyro_{a}" for a in "xyz"), *(f"force_{a}" for a in "xyz")]
    names += [*(f"position_{a}" for a in "xyz"), *(f"quaternion_{a}" for a in "xyzw")]
    path = table(tmp_path / "r.csv", names, np.column_stack([still, poses]))
    said = refused(path, config)
    assert question in said and "say the unit in the column's name" in said


@pytest.fixture(scope="module")
def slow():
    """A recording whose fastest rate is 12 deg/s, less than what a fast vehicle turns with in rad/s."""
    t = np.arange(0, 6, 0.005)
    turn = Rotation.from_rotvec(0.1 * np.sin(np.outer(t, [2.0, 1.3, 0.7])))
    gyro = np.vstack([(turn[:-1].inv() * turn[1:]).as_rotvec() / 0.005, np.zeros(3)]) + 0.01
    place = 0.1 * np.sin(np.outer(t, [1.1, 2.0, 0.8]))
    force = turn.inv().apply([0.0, 0.0, 9.81])
    return Recording(t, gyro, force, t[::4], place[::4], turn.as_matrix()[::4], t[::4])


@pytest.mark.parametrize(
    ("gyro", "place", "time", "question"),
    [
        (180 / np.pi, 1.0, 1.0, "where the poses turn with 0.2"),
        (1.0, 1e3, 1.0, "is it in millimetres? expected m"),
        (1.0, 1.0, 1e9, "pose_time rises by 20000000.0000 each pose; is it in nanoseconds?"),
        (1.0, 1.0, 1.0, None),
    ],
)
def test_poses_show_other_units(tmp_path, config, slow, gyro, place, time, question):
    """In a file and in `Ukf.run`."""
    r = Recording(
        *(slow.imu_time, gyro * slow.gyro, slow.specific_force),
        *(time * slow.pose_time, place * slow.position, slow.rotation, time * slow.pose_arrival_time),
    )
    write_csv(tmp_path / "r.csv", r, arrival=False)
    if question is None:
        Recording.from_file(tmp_path / "r.csv", config).estimate(tilthex.Ukf(config))
        return
    said = refused(tmp_path / "r.csv", config)
    assert question in said and "say the unit in the column's name" in said
    with pytest.raises(ValueError, match=re.escape(question)):
        r.estimate(tilthex.Ukf(config))


def test_poses_of_another_time_are_refused(config, slow):
    with pytest.raises(ValueError, match=r"imu_time is 0 to 5\.99\d* s and pose_time is 1000 to 1005\.98 s"):
        tilthex.Ukf(config).run(
            *(slow.imu_time, slow.gyro, slow.specific_force, slow.pose_time + 1000, slow.position),
            slow.rotation,
        )


def test_a_unit_that_is_none_is_named(tmp_path, config, truth):
    path = table(
        tmp_path / "r.csv", ["time", *(f"gyro_{a} [furlong]" for a in "xyz"), *EUROC[4:]], inertial(truth)
    )
    assert "column 'gyro_x [furlong]' has the unit 'furlong'; expected rad/s" in refused(path, config)


def test_clocks_without_a_common_time_are_refused(tmp_path, config, truth):
    imu = table(tmp_path / "imu.csv", EUROC, inertial(truth, 1e9))
    rows = np.column_stack([1e9 * truth.pose_time, truth.position, quaternions(truth)])
    poses = table(tmp_path / "p.csv", ["t", *"xyz", "qx", "qy", "qz", "qw"], rows)
    assert "pose_time rises by 10000000.0000 each pose; is it in nanoseconds?" in refused(
        imu, config, poses=str(poses)
    )
    rows[:, 0] = truth.pose_time + 1000
    said = refused(imu, config, poses=str(table(poses, ["t", *"xyz", "qx", "qy", "qz", "qw"], rows)))
    assert "imu_time is 0 to 0.39" in said and "and pose_time is 1000 to 1000.39 s" in said
    assert "any time in common" in said


@pytest.mark.parametrize("missing", ["", "nan", "0"])
@pytest.mark.parametrize("what", ["quaternion", "position"])
def test_a_pose_without_numbers_was_not_seen(tmp_path, config, truth, missing, what):
    """In any format: here as a table, and as a MAT file with NaN."""
    hidden = np.arange(len(truth.pose_time)) % 10 == 5
    path = tmp_path / "q.csv"
    write_csv(path, truth, arrival=False)
    first, last = (10, 14) if what == "quaternion" else (7, 10)
    if missing == "0" and what == "position":
        pytest.skip("the origin is a position")
    lines = path.read_text().splitlines()
    for k in np.flatnonzero(hidden):
        fields = lines[201 + k].split(",")
        fields[first:last] = [missing] * (last - first)
        lines[201 + k] = ",".join(fields)
    path.write_text("\n".join(lines))
    found = Recording.from_file(path, config)
    assert len(found.pose_time) == len(truth.pose_time)
    seen = truth.select(np.flatnonzero(~hidden))
    same(found.tracked(), seen, 1e-9, FIELDS[:-1])
    outcome = np.array(found.estimate(tilthex.Ukf(config)).outcome)
    assert set(outcome[hidden]) == {"invalid"} and "invalid" not in outcome[~hidden]
    position, matrices, xyzw = truth.position.copy(), truth.rotation.copy(), quaternions(truth)
    for values in (xyzw, matrices) if what == "quaternion" else (position,):
        values[hidden] = np.nan
    imu = {"time": truth.imu_time, "gyro": truth.gyro, "acc": truth.specific_force}
    for turn in ({"quat_xyzw": xyzw}, {"R": matrices}):
        pose = {"t": truth.pose_time, "position": position} | turn
        pytest.importorskip("scipy.io").savemat(tmp_path / "r.mat", {"imu": imu, "pose": pose})
        same(Recording.from_file(tmp_path / "r.mat", config).tracked(), seen, 1e-9, FIELDS[:-1])


def test_tables_of_euroc_and_tum_are_read(tmp_path, config, truth):
    """The ground truth of EuRoC has nanoseconds since 1970 without a unit, TUM has blanks and remarks."""
    since = 1.4e9
    xyzw = quaternions(truth)
    rows = inertial(truth)
    rows[:, 0] = np.round((rows[:, 0] + since) * 1e9)
    imu = table(tmp_path / "imu.csv", EUROC, rows)
    time = truth.pose_time + since
    wxyz = np.column_stack([np.round(1e9 * time), truth.position, xyzw[:, [3, 0, 1, 2]]])
    euroc = table(tmp_path / "gt.csv", EUROC_POSE, wxyz)
    lines = [
        "# ground truth, file: x.bag",
        "# timestamp tx ty tz qx qy qz qw",
        *(
            f"{t:.6f} " + " ".join(f"{x:.9f}" for x in row)
            for t, row in zip(time, np.c_[truth.position, xyzw], strict=True)
        ),
    ]
    tum = tmp_path / "tum.csv"
    tum.write_text("\n".join(lines) + "\n")
    for poses in (euroc, tum):
        found = Recording.from_file(imu, config, poses=str(poses))
        np.testing.assert_allclose(found.pose_time - since, truth.pose_time, atol=1e-6)
        np.testing.assert_allclose(found.position, truth.position, atol=1e-8)
        np.testing.assert_allclose(found.rotation, truth.rotation, atol=1e-7)
    tum.write_text("\n".join([*lines[:5], lines[5] + " 1"]))
    assert "line 6 has 9 fields; expected 8" in refused(tum, config)


@pytest.mark.parametrize("text", ["", "\n \n"])
def test_an_empty_table_is_named(tmp_path, config, text):
    (tmp_path / "r.csv").write_text(text)
    assert "r.csv is empty; expected names in its first line" in refused(tmp_path / "r.csv", config)
