"""Logs as they are: every format, packed, of several channels, odd and damaged; what was read is told."""

import gzip
import struct
import tracemalloc
from collections import Counter

import can
import pytest

from sidestep.controller.can_port.bus.candump import CandumpWriter
from sidestep.controller.can_port.bus.log import READABLE, LogReport, open_log, read_log
from sidestep.plant_models.errors import InputError

FRAMES = [
    can.Message(1.5, 0x101, False, data=bytes(range(8)), channel=0),
    can.Message(1.51, 0x1ABCDEF0, True, data=b"\1\2", channel=0),
    can.Message(1.52, 0x102, False, data=b"", channel=0),
    can.Message(1.53, 0x103, False, data=bytes(range(12)), is_fd=True, bitrate_switch=True, channel=0),
]
CLASSIC = [frame for frame in FRAMES if not frame.is_fd]


def keys(frames):
    return [(frame.arbitration_id, frame.is_extended_id, frame.is_fd, bytes(frame.data)) for frame in frames]


def written(path, frames):
    writer = {".trc": can.TRCWriter, ".db": can.SqliteWriter}.get(path.suffix)
    with writer(path) if writer else open_log(path) as log:
        for frame in frames:
            log.on_message_received(frame)
    return path


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("ending", [".blf", ".asc", ".log", ".csv", ".trc", ".db"])
def test_every_format_reads_back(ending, packed, tmp_path):
    fd = ending not in (".trc", ".db")  # of these python-can's own writers lose the flag, or the frame
    path = written(tmp_path / f"a{ending}", FRAMES if fd else CLASSIC)
    if packed:
        path = tmp_path / f"a{ending}.gz"
        path.write_bytes(gzip.compress((tmp_path / f"a{ending}").read_bytes()))
    got = list(read_log(path))
    assert keys(got) == keys(FRAMES if fd else CLASSIC)
    steps = [frame.timestamp - got[0].timestamp for frame in got]
    assert steps == pytest.approx([0.0, 0.01, 0.02, 0.03][: len(got)], abs=2e-4)


def test_candump_s_own_lines_read_back(tmp_path):
    odd = [
        *FRAMES,
        can.Message(1.6, 0x7FF, False, is_remote_frame=True, dlc=3),
        can.Message(1.7, 4, is_error_frame=True),
    ]
    with (tmp_path / "a.log").open("w") as file:
        writer = CandumpWriter(file)
        for frame in odd:
            frame.channel = "vcan0"
            writer.on_message_received(frame)
    report = LogReport()
    assert keys(read_log(tmp_path / "a.log", report=report)) == keys(FRAMES)
    assert report.others == Counter({"remote frames": 1, "error frames": 1})
    assert report.sentences() == ["1 remote frames left aside", "1 error frames left aside"]


def test_candump_without_its_option(tmp_path):
    (tmp_path / "a.log").write_text(
        " (1700000000.100000)  can0  101   [3]  01 02 AB\n (1700000000.200000)  can0  1ABCDEF0   [2]  00 FF\n"
        "  can0  102   [0] \n (1700000000.300000)  can0  103  [12]  00 01 02 03 04 05 06 07 08 09 0A 0B\n"
        " (1700000000.400000)  can0  104   [2]  remote request\n"
    )
    got = list(read_log(tmp_path / "a.log"))
    assert keys(got) == [(0x101, False, False, b"\1\2\xab"), (0x1ABCDEF0, True, False, b"\0\xff"),
                         (0x102, False, False, b""), (0x103, False, True, bytes(range(12)))]  # fmt: skip
    assert got[0].timestamp == 1700000000.1


def test_savvycan(tmp_path):
    (tmp_path / "a.csv").write_text(
        "Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8\n"
        "1500000,00000101,false,Rx,0,3,01,02,AB,\n2500000,1ABCDEF0,true,Tx,1,1,FF,\n"
    )
    got = list(read_log(tmp_path / "a.csv"))
    assert keys(got) == [(0x101, False, False, b"\1\2\xab"), (0x1ABCDEF0, True, False, b"\xff")]
    assert [(frame.timestamp, frame.channel, frame.is_rx) for frame in got] == [(1.5, 0, True), (2.5, 1, False)]


@pytest.mark.parametrize("encoding", ["utf-8-sig", "cp1252"])
def test_byte_order_marks_and_old_encodings(encoding, tmp_path):
    text = (
        "date Mon Nov 27 08:00:00.000 am 2026\nbase hex  timestamps absolute\ninternal events logged\n"
        "// Prüfstand\nBegin Triggerblock Mon Nov 27 08:00:00.000 am 2026\n"
        "   0.000000 Start of measurement\n   0.000000 CANFD   1 Start of measurement\n"
        "   0.010000 1  101             Rx   d 2 01 02\nEnd TriggerBlock\n"
    )
    (tmp_path / "a.asc").write_bytes(text.encode(encoding))
    assert keys(read_log(tmp_path / "a.asc")) == [(0x101, False, False, b"\1\2")]


def test_channels_and_time_that_goes_back(tmp_path):
    (tmp_path / "a.log").write_text("(2.0) can0 101#01\n(1.0) can1 101#02\n(3.0) can0 101#03\n")
    report = LogReport()
    assert len(list(read_log(tmp_path / "a.log", report=report))) == 3
    assert report.sentences()[0] == "time goes back 1 times"
    assert "frames of several channels (can0: 2, can1: 1)" in report.sentences()[1]
    report = LogReport()
    assert [bytes(f.data) for f in read_log(tmp_path / "a.log", "can0", report)] == [b"\1", b"\3"]
    assert report.sentences() == []


# --- damage


@pytest.mark.parametrize(("ending", "damage", "words"), [
    (".log", b"(1.9) can0 101#0", "line 5: half a byte"),
    (".log", b"what is this\n", "line 5: 'what is this' is no line of candump"),
    (".csv", b"3.0,0x101,0,0,0,8,!!!!\n", "line 6: no frame"),
    (".asc", b"   9.0 1  1zz  Rx   d 2 01 02\n", ""),
])  # fmt: skip
def test_damaged_text_is_read_up_to_its_place(ending, damage, words, tmp_path):
    path = written(tmp_path / f"a{ending}", FRAMES)
    path.write_bytes(path.read_bytes() + damage)
    report = LogReport()
    assert len(list(read_log(path, report=report))) == 4
    assert words in report.damage
    assert not words or "4 frames read before" in report.damage


@pytest.mark.parametrize("cut", [0.4, 0.7, 0.95])
@pytest.mark.parametrize("packed", [False, True])
def test_a_blf_cut_short_is_read_up_to_there(cut, packed, tmp_path):
    frames = [can.Message(0.01 * k, 0x101, False, data=k.to_bytes(4, "big") * 2, channel=0) for k in range(2000)]
    data = written(tmp_path / "a.blf", frames).read_bytes()
    path = tmp_path / ("b.blf.gz" if packed else "b.blf")
    whole = gzip.compress(data, 1) if packed else data
    path.write_bytes(whole[: int(cut * len(whole))])
    report = LogReport()
    got = list(read_log(path, report=report))
    assert 0 < len(got) < 2000
    assert keys(got) == keys(frames[: len(got)])
    assert "damaged: " in report.damage
    assert f"{len(got)} frames read before" in report.damage


def test_a_blf_that_lacks_objects_says_how_many(tmp_path):
    data = bytearray(written(tmp_path / "a.blf", FRAMES).read_bytes())
    data[32:36] = struct.pack("<L", 9)  # the header's count
    (tmp_path / "a.blf").write_bytes(data)
    report = LogReport()
    assert len(list(read_log(tmp_path / "a.blf", report=report))) == 4
    assert "ends after 4 of 9 objects" in report.damage


@pytest.mark.parametrize("inside", [False, True])
def test_an_object_of_size_0_ends_the_reading(inside, tmp_path):
    """python-can 4.6 turns round at one for ever (its issue 1584)."""
    data = written(tmp_path / "a.blf", FRAMES).read_bytes()
    nothing = b"LOBJ" + struct.pack("<HHLL", 16, 1, 0, 1) + bytes(16)
    if inside:
        head = struct.pack("<HHQ8sQ", 0, 0, 0, b"", 0)[:16]
        content = struct.pack("<H6xL4x", 0, len(nothing)) + nothing
        nothing = b"LOBJ" + struct.pack("<HHLL", 16, 1, 16 + len(content), 10) + content
        assert len(head) == 16
    (tmp_path / "a.blf").write_bytes(data + nothing)
    report = LogReport()
    assert len(list(read_log(tmp_path / "a.blf", report=report))) == 4
    assert ("object of size 0" in report.damage) or ("no object of any size" in report.damage)


@pytest.mark.parametrize("ending", READABLE)
def test_a_file_that_is_none_is_one_line(ending, tmp_path):
    (tmp_path / f"a{ending}").write_bytes(b"\x00\xff nothing of the kind, but long enough for a header" * 9)
    if ending == ".asc":  # python-can's reader passes over what it does not know
        assert list(read_log(tmp_path / f"a{ending}")) == []
        return
    with pytest.raises(InputError) as caught:
        list(read_log(tmp_path / f"a{ending}"))
    assert "cannot read the CAN log" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_memory_stays_flat(tmp_path):
    def peak(count):
        path = tmp_path / f"{count}.log"
        path.write_text("".join(f"({0.001 * k:.6f}) can0 101#{k:016X}\n" for k in range(count)))
        tracemalloc.start()
        total = sum(1 for _ in read_log(path))
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert total == count
        return most

    assert peak(40_000) < 1.2 * peak(4_000) + 50_000
