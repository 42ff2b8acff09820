"""Files become channels: every kind, with its own units, rates and gaps."""

import gzip

import can
import cantools
import numpy as np
import pytest

from sidestep.plant_models.errors import InputError
from sidestep.validation.model_error.logs.channels import read_channels
from sidestep.validation.model_error.logs.mapping import read_map
from sidestep.validation.model_error.logs.measured import PERIOD, load_log
from sidestep.validation.model_error.logs.names import find
from sidestep.validation.model_error.logs.units import factor, split_unit

CAR = "[vehicle]\nmass = 1000.0\nl_f = 1.2\nl_r = 1.4\n"
TIME = np.arange(0.0, 20.0, 0.02)
TURN = 0.3 * np.sin(TIME)
SPEED = 20.0 + np.cos(0.3 * TIME)
DBC = """VERSION ""
BS_:
BU_: CAR
BO_ 37 STEER: 4 CAR
 SG_ ANGLE : 7|16@0- (0.1,0) [-1000|1000] "deg" CAR
BO_ 36 MOTION: 6 CAR
 SG_ YAW : 7|16@0- (0.01,0) [-300|300] "deg/s" CAR
 SG_ SPEED : 23|16@0+ (0.01,0) [0|300] "km/h" CAR
"""


@pytest.fixture
def mapping(tmp_path):
    def write(text="", name="map.toml"):
        (tmp_path / name).write_text(text + CAR, encoding="utf-8")
        return read_map(tmp_path / name)

    return write


def table(heads="time [s],yaw_rate [rad/s],v_x [m/s],steer_angle_front [rad]", columns=None):
    rows = np.column_stack(columns or (TIME, TURN, SPEED, TURN / 8.0))
    return heads + "\n" + "\n".join(",".join(f"{x:.9g}" for x in row) for row in rows) + "\n"


@pytest.mark.parametrize(("unit", "kind", "si"), [
    ("deg/s", "rate", np.pi / 180.0), ("m/s^2", "acceleration", 1.0), ("m/s²", "acceleration", 1.0),
    ("g", "acceleration", 9.81), ("km/h", "speed", 1 / 3.6), ("kmph", "speed", 1 / 3.6), ("°", "angle", np.pi / 180.0),
    ("ms", "time", 1e-3), ("", "speed", 1.0),
])  # fmt: skip
def test_units(unit, kind, si):
    assert factor(kind, unit, "x") == pytest.approx(si)


def test_a_unit_of_another_kind_is_refused():
    with pytest.raises(InputError, match="'deg' is no unit of speed"):
        factor("speed", "deg", "signals.v_x")


@pytest.mark.parametrize("head", ["yaw rate [deg/s]", "yaw rate(deg/s)", "# yaw rate (deg/s) "])
def test_units_in_heads(head):
    assert split_unit(head) == ("yaw rate", "deg/s")


def test_names_are_found_and_the_surest_wins():
    names = ["CAN1.StW_Angle", "Yaw-Rate", "speed", "V_x", "Accel Y"]
    assert [find(s, names) for s in ("yaw_rate", "v_x", "a_y", "v_y")] == ["Yaw-Rate", "V_x", "Accel Y", None]


@pytest.mark.parametrize("packed", [False, True])
def test_csv_by_names_alone(mapping, tmp_path, packed):
    file = tmp_path / ("log.csv.gz" if packed else "log.csv")
    file.write_bytes(gzip.compress(table().encode()) if packed else table().encode())
    log = load_log(file, mapping())
    inside = slice(100, -100)
    np.testing.assert_allclose(log.signals["yaw_rate"], np.interp(log.time, TIME, TURN), atol=1e-6)
    np.testing.assert_allclose(log.signals["v_x"][inside], np.interp(log.time, TIME, SPEED)[inside], atol=1e-3)
    assert log.steer_gain == 1.0
    assert any("yaw_rate found as" in note for note in log.notes)


def test_decimal_commas(mapping, tmp_path):
    text = table().replace(",", ";").replace(".", ",").replace("Hz", "")
    (tmp_path / "log.csv").write_text(text, encoding="utf-8")
    log = load_log(tmp_path / "log.csv", mapping())
    assert np.ptp(log.signals["yaw_rate"]) == pytest.approx(0.6, abs=1e-3)


def test_degrees_signs_ratio_and_delay_of_a_mapping(mapping, tmp_path):
    late = np.interp(TIME - 0.1, TIME, TURN)
    columns = (1e3 * TIME, -np.degrees(late), 3.6 * SPEED, 14.0 * np.degrees(TURN / 8.0))
    (tmp_path / "log.csv").write_text(table("t (ms),gyro (deg/s),speed (km/h),wheel (deg)", columns), encoding="utf-8")
    log = load_log(tmp_path / "log.csv", mapping("""
[signals]
yaw_rate = { name = "gyro", sign = -1, delay = 0.1 }
v_x = "speed"
steering_wheel = { name = "wheel", ratio = 14.0 }
"""))  # fmt: skip
    inside = slice(50, -50)
    expected = np.interp(log.time + TIME[0], TIME, TURN)
    np.testing.assert_allclose(log.signals["yaw_rate"][inside], expected[inside], atol=2e-3)
    assert log.steer_gain == pytest.approx(1.0 / 14.0)
    assert log.delays == {"yaw_rate": 0.0}


def test_a_sign_that_was_not_told_is_found(mapping, tmp_path):
    (tmp_path / "log.csv").write_text(table(columns=(TIME, TURN, SPEED, -TURN / 8.0)), encoding="utf-8")
    log = load_log(tmp_path / "log.csv", mapping())
    assert np.corrcoef(log.signals["steer"], log.signals["yaw_rate"])[0, 1] > 0.99
    assert any("other sign" in note for note in log.notes)


def test_gaps_spikes_and_slow_driving(mapping, tmp_path):
    there = (TIME < 8.0) | (TIME > 10.0)
    turn = TURN.copy()
    turn[100] += 3.0
    speed = np.where(TIME > 15.0, 2.0, SPEED)
    columns = tuple(c[there] for c in (TIME, turn, speed, TURN / 8.0))
    (tmp_path / "log.csv").write_text(table(columns=columns), encoding="utf-8")
    log = load_log(tmp_path / "log.csv", mapping())
    assert not log.usable[(log.time > 8.05) & (log.time < 9.95)].any()
    assert not log.usable[log.time > 15.2].any()
    assert log.usable[log.time < 7.9].all()
    assert [b - a for a, b in log.stretches(1)] == pytest.approx([8.0 / PERIOD, 4.7 / PERIOD], abs=40)
    assert np.abs(log.signals["yaw_rate"]).max() < 0.35
    assert any("spike" in note for note in log.notes)


def test_channels_of_other_rates_meet_on_one_grid(mapping, tmp_path):
    asammdf = pytest.importorskip("asammdf")
    slow = np.arange(0.0, 20.0, 0.04)
    signals = [
        asammdf.Signal(np.degrees(TURN), TIME, unit="deg/s", name="YawRate"),
        asammdf.Signal(3.6 * np.interp(slow, TIME, SPEED), slow, unit="km/h", name="Speed"),
        asammdf.Signal(np.degrees(TURN / 8.0), TIME, unit="deg", name="RoadWheelAngle"),
    ]
    with asammdf.MDF(version="4.10") as mdf:
        for signal in signals:
            mdf.append(signal)
        mdf.save(tmp_path / "log.mf4")
    log = load_log(tmp_path / "log.mf4", mapping())
    np.testing.assert_allclose(log.signals["yaw_rate"], np.interp(log.time, TIME, TURN), atol=1e-6)
    assert log.signals["v_x"].mean() == pytest.approx(SPEED.mean(), abs=0.05)


@pytest.mark.parametrize("ending", [".log", ".asc", ".blf", ".log.gz"])
def test_can_frames_by_a_database(mapping, tmp_path, ending):
    (tmp_path / "car.dbc").write_text(DBC, encoding="utf-8")
    database = cantools.database.load_file(tmp_path / "car.dbc")
    file = tmp_path / f"log{ending.removesuffix('.gz')}"
    writer = {".log": can.CanutilsLogWriter, ".asc": can.ASCWriter, ".blf": can.BLFWriter}[file.suffix]
    with writer(file) as out:
        for t, turn, speed in zip(TIME, TURN, SPEED, strict=True):
            for name, values in (
                ("STEER", {"ANGLE": np.degrees(turn)}), ("MOTION", {"YAW": np.degrees(turn), "SPEED": 3.6 * speed}),
            ):  # fmt: skip
                message = database.get_message_by_name(name)
                data = message.encode({key: float(value) for key, value in values.items()})
                out.on_message_received(
                    can.Message(1.7e9 + t, message.frame_id, is_extended_id=False, data=data[: 2 if t > 19.9 else 8])
                )
            out.on_message_received(can.Message(1.7e9 + t, 99, is_extended_id=False, data=b"x"))
    if ending.endswith(".gz"):
        (tmp_path / "log.log.gz").write_bytes(gzip.compress(file.read_bytes()))
    log = load_log(tmp_path / f"log{ending}", mapping("""
dbc = "car.dbc"
[signals]
steering_wheel = "STEER.ANGLE"
yaw_rate = "YAW"
v_x = "SPEED"
"""))  # fmt: skip
    np.testing.assert_allclose(log.signals["yaw_rate"], np.interp(log.time, TIME, TURN), atol=5e-4)
    assert log.steer_gain == 0.0
    assert any("1 ids are not in the database" in note for note in log.notes)
    assert any("frames of MOTION do not fit" in note for note in log.notes)


@pytest.mark.parametrize(("text", "words"), [
    ("[signals]\nyaw_rat = 'x'\n", "did you mean yaw_rate"),
    ("[signals]\nv_x = { name = 'x', sing = 1 }\n", "did you mean sign"),
    ("least_speed = 1.0\n", "least_speed"), ("dbc = 'none.dbc'\n", "no file"), ("rear_drive = 2.0\n", "rear_drive"),
])  # fmt: skip
def test_a_mapping_names_what_is_wrong_with_it(mapping, text, words):
    with pytest.raises(InputError, match=words):
        mapping(text)


def test_a_mapping_without_a_car_says_what_is_missing(tmp_path):
    (tmp_path / "map.toml").write_text("[vehicle]\nmass = 1000.0\n", encoding="utf-8")
    with pytest.raises(InputError, match="missing l_f, l_r"):
        read_map(tmp_path / "map.toml")


@pytest.mark.parametrize(("name", "content", "words"), [
    ("log.csv", "time,yaw_rate,v_x\n" + "0,0,0\n0.1,0,0\n" * 20, "backwards|not told"),
    ("log.xyz", "x", "unknown kind"), ("log.blf", "x", "dbc"), ("log.csv", "one\n", "no columns"),
    ("log.csv", table(), "signals.v_x"), ("log.mf4", "no mdf", "cannot be read"), ("log.csv.gz", "x", "unpacked"),
])  # fmt: skip
def test_a_log_names_what_is_wrong_with_it(mapping, tmp_path, name, content, words):
    if "mf4" in name:
        pytest.importorskip("asammdf")
    (tmp_path / name).write_text(content, encoding="utf-8")
    told = mapping('[signals]\nv_x = "nothing"\n') if words == "signals.v_x" else mapping()
    with pytest.raises(InputError, match=words):
        load_log(tmp_path / name, told)


def test_parquet(mapping, tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    columns = {"t": TIME, "yaw_rate [rad/s]": TURN, "v_x": SPEED, "road_wheel_angle": TURN / 8.0}
    parquet.write_table(pyarrow.table(columns), tmp_path / "log.parquet")
    channels, _ = read_channels(tmp_path / "log.parquet", mapping())
    np.testing.assert_array_equal(channels["yaw_rate [rad/s]"].values, TURN)
