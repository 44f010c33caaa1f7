"""Recordings of other programs, written by their own libraries and read again."""

import json
import struct

import numpy as np
import pytest
import tilthex
from scipy.spatial.transform import Rotation
from test_estimate import recorded, write_csv
from tilthex.__main__ import main
from tilthex.recording import Recording

FIELDS = ("imu_time", "gyro", "specific_force", "pose_time", "position", "rotation", "pose_arrival_time")


@pytest.fixture(scope="module")
def config():
    return tilthex.Config.default(tilthex.Vehicle.preset("tilt-hex"))


@pytest.fixture(scope="module")
def truth():
    """Times begin at 100 s, so that they are positive stamps."""
    r = recorded(200)
    return Recording(r.imu_time + 100, r.gyro, r.specific_force, r.pose_time + 100, *_poses(r))


def _poses(r):
    return r.position, r.rotation, r.pose_arrival_time + 100


def same(found, truth, atol=1e-9, fields=FIELDS):
    for name in fields:
        np.testing.assert_allclose(getattr(found, name), getattr(truth, name), atol=atol, err_msg=name)


def refused(path, config, **options):
    with pytest.raises(ValueError) as error:
        Recording.from_file(path, config, **options)
    said = str(error.value)
    assert "\n" not in said and str(path) in said
    return said


def quaternions(recording):
    return Rotation.from_matrix(recording.rotation).as_quat()


def table(path, names, rows, bom=False, separator=","):
    text = separator.join(names) + "\n" + "\n".join(separator.join(f"{x:.17g}" for x in row) for row in rows)
    path.write_text(text + "\n", encoding="utf-8-sig" if bom else "utf-8")
    return path


def inertial(truth, time=1.0, gyro=1.0, force=1.0):
    return np.column_stack([time * truth.imu_time, gyro * truth.gyro, force * truth.specific_force])


EUROC = [
    "#timestamp [ns]",
    *(f"w_RS_S_{a} [rad s^-1]" for a in "xyz"),
    *(f"a_RS_S_{a} [m s^-2]" for a in "xyz"),
]
EUROC_POSE = ["#timestamp", *(f"p_RS_R_{a} [m]" for a in "xyz"), *(f"q_RS_{a} []" for a in "wxyz")]


@pytest.mark.parametrize("bom", [True, False])
@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_tables_of_euroc_in_two_files(tmp_path, config, truth, bom, separator):
    imu = table(tmp_path / "imu.csv", EUROC, inertial(truth, 1e9), bom, separator)
    xyzw = quaternions(truth)
    rows = np.column_stack([truth.pose_time, truth.position, xyzw[:, 3], xyzw[:, :3]])
    names = ["timestamp [s]", *EUROC_POSE[1:]]
    poses = table(tmp_path / "poses.csv", names, rows, bom, separator)
    same(Recording.from_file(imu, config, poses=str(poses)), truth, 1e-6)


@pytest.mark.parametrize("off", [0.0, 1e-5, 5e-3])
def test_near_rotations_are_made_rotations(tmp_path, config, truth, off):
    """Also into the estimator: no NaN, and no error."""
    random = np.random.default_rng(1)
    matrices = truth.rotation + random.uniform(-off, off, truth.rotation.shape)
    found = Recording.from_file(written(tmp_path, truth, matrices), config)
    product = found.rotation @ np.swapaxes(found.rotation, 1, 2)
    np.testing.assert_allclose(product, np.broadcast_to(np.eye(3), product.shape), atol=1e-12)
    np.testing.assert_allclose(found.rotation, truth.rotation, atol=2 * off + 1e-12)
    run = found.estimate(tilthex.Ukf(config))
    near = Recording(*(getattr(found, name) for name in FIELDS[:5]), matrices, found.pose_arrival_time)
    np.testing.assert_allclose(near.estimate(tilthex.Ukf(config)).position, run.position, atol=1e-9)
    assert np.isfinite(run.position[-1]).all() and np.isfinite(run.rotation[-1]).all()


def written(tmp_path, truth, matrices):
    """Samples and poses as matrices, in one table."""
    names = [*"xyz", *(f"r{i}{j}" for i in "123" for j in "123")]
    lines = [",".join(["time", *EUROC[1:], *names])]
    lines += [",".join(f"{x:.17g}" for x in row) + "," * 12 for row in inertial(truth)]
    for t, *pose in np.column_stack([truth.pose_time, truth.position, matrices.reshape(-1, 9)]):
        lines.append(f"{t:.17g}" + "," * 7 + ",".join(f"{x:.17g}" for x in pose))
    (tmp_path / "r.csv").write_text("\n".join(lines))
    return tmp_path / "r.csv"


def changed(path, line, fields):
    """Changes some fields of a line of a table."""
    lines = path.read_text().splitlines()
    row = lines[line].split(",")
    for place, text in fields.items():
        row[place] = text
    lines[line] = ",".join(row)
    path.write_text("\n".join(lines))


def test_what_is_no_rotation_is_named_with_its_line(tmp_path, config, truth):
    matrices = truth.rotation.copy()
    matrices[7] *= [1, 1, -1]
    assert f"line {2 + 200 + 7}: the matrix is not a rotation" in refused(
        written(tmp_path, truth, matrices), config
    )
    matrices[7] = 1.1 * truth.rotation[7]
    assert "1.0e-01 away" in refused(written(tmp_path, truth, matrices), config)
    path = tmp_path / "q.csv"
    write_csv(path, truth)
    changed(path, 210, {10: "0.5", 11: "0.5", 12: "0.5", 13: "0.6"})
    assert "line 211: the quaternion [0.5, 0.5, 0.5, 0.6] is not of unit length" in refused(path, config)


@pytest.mark.parametrize(("line", "field", "name"), [(5, 5, "force_y"), (205, 11, "quaternion_y")])
def test_a_row_with_a_gap_is_named(tmp_path, config, truth, line, field, name):
    path = tmp_path / "q.csv"
    write_csv(path, truth)
    changed(path, line, {field: ""})
    assert f"line {line + 1} has no number for {name}" in refused(path, config)


@pytest.mark.parametrize("order", ["xyzw", "wxyz"])
def test_mat_files(tmp_path, config, truth, order):
    scipy_io = pytest.importorskip("scipy.io")
    xyzw = quaternions(truth)
    turns = xyzw if order == "xyzw" else xyzw[:, [3, 0, 1, 2]]
    imu = {"time": truth.imu_time, "gyro": truth.gyro, "acc": truth.specific_force}
    pose = {"t": truth.pose_time, "position": truth.position, f"quat_{order}": turns}
    scipy_io.savemat(tmp_path / "r.mat", {"imu": imu, "mocap": pose, "note": "text"})
    same(Recording.from_file(tmp_path / "r.mat", config), truth)
    pose = {"t": truth.pose_time, "position": truth.position.T, "R": np.moveaxis(truth.rotation, 0, 2)}
    scipy_io.savemat(tmp_path / "r.mat", {"imu": imu, "pose": pose})
    same(Recording.from_file(tmp_path / "r.mat", config), truth)
    pose = {"t": truth.pose_time, "position": truth.position, "quaternion": turns}
    scipy_io.savemat(tmp_path / "r.mat", {"imu": imu, "pose": pose})
    assert "expected a name that ends in _xyzw or _wxyz" in refused(tmp_path / "r.mat", config)
    (tmp_path / "r.mat").write_bytes(b"no such thing")
    assert "cannot be read as a MAT file" in refused(tmp_path / "r.mat", config)


def ulog(path, truth, newer):
    """A log of PX4, byte by byte as its documentation says."""
    flip = np.array([1, -1, -1.0])
    f32 = ";".join
    sensor = f32(["uint64_t timestamp", "float[3] gyro_rad", "float[3] accelerometer_m_s2"])
    places = ["float[3] position"] if newer else ["float x", "float y", "float z"]
    pose = f32(["uint64_t timestamp", "uint64_t timestamp_sample", *places, "float[4] q"])

    def message(kind, body):
        return struct.pack("<HB", len(body), ord(kind)) + body

    out = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0) + message("B", bytes(40))
    out += message("F", b"sensor_combined:" + sensor.encode() + b";")
    out += message("F", b"vehicle_visual_odometry:" + pose.encode() + b";")
    out += message("A", struct.pack("<BH", 0, 0) + b"sensor_combined")
    out += message("A", struct.pack("<BH", 0, 1) + b"vehicle_visual_odometry")
    for t, w, f in zip(truth.imu_time, truth.gyro * flip, truth.specific_force * flip, strict=True):
        out += message("D", struct.pack("<HQ6f", 0, round(1e6 * t), *w, *f))
    # Turned about x by half a turn on both sides.
    turned = Rotation.from_matrix(np.diag(flip) @ truth.rotation @ np.diag(flip)).as_quat()
    for t, p, (x, y, z, w) in zip(truth.pose_time, truth.position * flip, turned, strict=True):
        stamp = round(1e6 * t)
        out += message("D", struct.pack("<HQQ7f", 1, stamp + 5000, stamp, *p, w, x, y, z))
    path.write_bytes(out)


@pytest.mark.parametrize("newer", [True, False])
def test_logs_of_px4(tmp_path, config, truth, newer):
    pytest.importorskip("pyulog", reason="pip install 'tilthex[logs]'")
    ulog(tmp_path / "f.ulg", truth, newer)
    found = Recording.from_file(tmp_path / "f.ulg", config)
    same(found, truth, 2e-6, FIELDS[:-1])
    np.testing.assert_allclose(found.pose_arrival_time, truth.pose_time + 0.005, atol=2e-6)
    (tmp_path / "f.ulg").write_bytes(b"no such thing")
    assert "cannot be read as a log of PX4" in refused(tmp_path / "f.ulg", config)


@pytest.mark.parametrize("storage", ["SQLITE3", "MCAP"])
@pytest.mark.parametrize(
    "kind", ["PoseStamped", "TransformStamped", "TFMessage", "Odometry", "PoseWithCovarianceStamped"]
)
def test_bags_of_ros_2(tmp_path, config, truth, storage, kind):
    pytest.importorskip("rosbags", reason="pip install 'tilthex[logs]'")
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    m = store.types
    module = {"Odometry": "nav_msgs", "TFMessage": "tf2_msgs"}.get(kind, "geometry_msgs")
    name = f"{module}/msg/{kind}"

    def header(t):
        stamp = m["builtin_interfaces/msg/Time"](int(t), round(1e9 * (t % 1)))
        return m["std_msgs/msg/Header"](stamp, "body")

    vector, turn = m["geometry_msgs/msg/Vector3"], m["geometry_msgs/msg/Quaternion"]
    none = np.zeros(9)

    def pose_message(t, p, q):
        pose = m["geometry_msgs/msg/Pose"](m["geometry_msgs/msg/Point"](*p), turn(*q))
        whole = m["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36))
        if kind in ("TransformStamped", "TFMessage"):
            moved = m["geometry_msgs/msg/Transform"](vector(*p), turn(*q))
            one = m["geometry_msgs/msg/TransformStamped"](header(t), "body", moved)
            return one if kind == "TransformStamped" else m[name]([one])
        if kind == "PoseStamped":
            return m[name](header(t), pose)
        if kind == "PoseWithCovarianceStamped":
            return m[name](header(t), whole)
        twist = m["geometry_msgs/msg/Twist"](vector(9, 9, 9), vector(9, 9, 9))
        return m[name](header(t), "b", whole, m["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36)))

    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin[storage]) as bag:
        imu = bag.add_connection("/imu/data", "sensor_msgs/msg/Imu", typestore=store)
        poses = bag.add_connection("/mocap", name, typestore=store)
        for t, w, f in zip(truth.imu_time, truth.gyro, truth.specific_force, strict=True):
            data = m[imu.msgtype](header(t), turn(0, 0, 0, 1), none, vector(*w), none, vector(*f), none)
            bag.write(imu, round(1e9 * t), store.serialize_cdr(data, imu.msgtype))
        for t, p, q in zip(truth.pose_time, truth.position, quaternions(truth), strict=True):
            data = store.serialize_cdr(pose_message(t, p.tolist(), q.tolist()), name)
            bag.write(poses, round(1e9 * (t + 0.01)), data)
    paths = [tmp_path / "bag", *(tmp_path / "bag").glob("bag*.mcap"), *(tmp_path / "bag").glob("*.db3")]
    assert len(paths) == 2
    for path in paths:
        found = Recording.from_file(path, config)
        same(found, truth, 1e-6, FIELDS[:-1])
        np.testing.assert_allclose(found.pose_arrival_time, truth.pose_time + 0.01, atol=1e-6)
    frame = "/body" if kind == "TFMessage" else ""
    assert f"has no '/other'; it has /imu/data, /mocap{frame}" in refused(
        tmp_path / "bag", config, imu="/other"
    )


def foreign_mcap(path, topics):
    """Messages in JSON: {topic: [(time, message)]}."""
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("any", "jsonschema", b"{}")
        for topic, messages in topics.items():
            channel = writer.register_channel(topic, "json", schema)
            for t, message in messages:
                stamp = round(1e9 * t)
                writer.add_message(channel, stamp, json.dumps(message).encode(), stamp)
        writer.finish()


def topics_of(truth):
    imu = [
        (t, {"angular_velocity": dict(zip("xyz", w, strict=True)), "linear_acceleration": list(f)})
        for t, w, f in zip(truth.imu_time, truth.gyro, truth.specific_force, strict=True)
    ]
    poses = [
        (t, {"timestamp": {"sec": int(t), "nsec": round(1e9 * (t % 1))}, "pose": {"position": list(p)}})
        for t, p in zip(truth.pose_time, truth.position, strict=True)
    ]
    for (_, message), q in zip(poses, quaternions(truth), strict=True):
        message["pose"]["orientation"] = dict(zip("xyzw", q, strict=True))
    return {"/imu": imu, "/pose": poses}


def test_mcap_files_of_other_programs(tmp_path, config, truth):
    path = tmp_path / "f.mcap"
    topics = topics_of(truth)
    foreign_mcap(path, topics)
    same(Recording.from_file(path, config), truth, 1e-6)
    foreign_mcap(path, topics | {"/imu2": topics["/imu"]})
    assert "inertial samples in /imu, /imu2: name one with --imu" in refused(path, config)
    same(Recording.from_file(path, config, imu="/imu2", poses="/pose"), truth, 1e-6)
    foreign_mcap(path, {"/input": [(1.0, {"text": "hello"})], "/pose": topics["/pose"]})
    assert "holds no inertial samples with their usual names; it has /input, /pose" in refused(path, config)
    foreign_mcap(path, {})
    assert "holds no topic at all" in refused(path, config)


def test_the_command_names_streams(tmp_path, truth, capsys):
    foreign_mcap(tmp_path / "f.mcap", topics_of(truth))
    assert main(["estimate", str(tmp_path / "f.mcap"), "--imu", "/imu", "--poses", "/pose"]) == 0
    assert "200 inertial samples" in capsys.readouterr().out
    assert main(["estimate", str(tmp_path / "no.mcap")]) == 2
    assert "no.mcap does not exist" in capsys.readouterr().err
