"""The cache hands out whole entries only, and what a killed process left is swept up."""

import os
import signal
import subprocess
import sys
import time
import zipfile

import pytest
from support.fmus.fmu_files import QUICK

from sidestep.fmu import scratch
from sidestep.fmu.compiling import platforms
from sidestep.fmu.compiling.cache import cached
from sidestep.fmu.native.build import build_fmu
from sidestep.fmu.scratch import discard, scratch_folder


@pytest.fixture
def empty_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(platforms, "_FLAGS", (*platforms._FLAGS, *QUICK))
    return tmp_path / "cache" / "sidestep"


def damage(file, how):
    data = file.read_bytes()
    other = data[:18] + b"\xb7" + data[19:]  # e_machine of an ELF: AArch64
    new = {"cut": data[: len(data) // 2], "garbage": b"garbage", "empty": b"", "other machine": other}
    file.write_bytes(new[how])


@pytest.mark.parametrize("how", ["cut", "garbage", "empty", "other machine"])
@pytest.mark.parametrize("suffix", [".fmu", ".so"])
def test_a_broken_entry_is_built_again(empty_cache, how, suffix):
    first = build_fmu("linear")
    right = first.read_bytes()
    [entry] = empty_cache.glob(f"*{suffix}")
    if suffix == ".so":
        first.unlink()
    damage(entry, how)
    assert build_fmu("linear").read_bytes() == right
    with zipfile.ZipFile(build_fmu("linear")) as archive:
        assert archive.testzip() is None
    assert len(list(empty_cache.iterdir())) == 2


def test_an_entry_is_built_once(empty_cache):
    calls = []
    for _ in range(2):
        assert cached("name", ".txt", lambda: calls.append(1) or b"text").read_bytes() == b"text"
    assert calls == [1]


KILLED = """
import sys, time
from pathlib import Path
from sidestep.fmu.scratch import scratch_folder
(scratch_folder("build", Path(sys.argv[1])) / "half.c").write_text("int")
print("there", flush=True)
time.sleep(60)
"""


def test_what_a_killed_process_left_is_swept_up_and_nothing_else(tmp_path):
    mine, strangers = scratch_folder("fmu", tmp_path), tmp_path / "sidestep-fmu-notes.d"
    strangers.mkdir()
    process = subprocess.Popen([sys.executable, "-c", KILLED, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    assert process.stdout
    assert process.stdout.readline() == "there\n"
    [theirs] = set(tmp_path.glob("sidestep-build-*"))
    discard(scratch_folder("fmu", tmp_path))
    assert theirs.exists()  # its owner lives
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    process.stdout.close()
    discard(scratch_folder("fmu", tmp_path))
    assert set(tmp_path.iterdir()) == {mine, strangers}
    discard(mine)
    discard(mine)
    assert not mine.exists()


def test_a_folder_without_its_lock_is_given_time(tmp_path, monkeypatch):
    folder = tmp_path / "sidestep-build-abc"
    folder.mkdir()
    discard(scratch_folder("fmu", tmp_path))
    assert folder.exists()
    later = time.time() + 2.0 * scratch._YOUNG
    monkeypatch.setattr(scratch.time, "time", lambda: later)
    discard(scratch_folder("fmu", tmp_path))
    assert not folder.exists()
