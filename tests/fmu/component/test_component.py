"""The compiled step without Python: the in-process controller's bits, nothing from the heap, nothing but libc."""

import math
import subprocess
from concurrent.futures import ThreadPoolExecutor
from dataclasses import astuple, replace
from pathlib import Path

import numpy as np
import pytest
from support.component import (
    ARENA,
    FOREIGN,
    INPUT,
    MEMORY_BYTES,
    OK,
    RANGE,
    TOO_MANY,
    Component,
    command_of,
    drive,
    in_process,
    load,
    scene_of,
    setup_for,
)

from sidestep.controller.records import OBSTACLES
from sidestep.fmu.compiling.platforms import compile_library
from sidestep.fmu.component.build import component_files, static_library
from sidestep.fmu.component.records import abi, obstacle_rows
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.signals import Status


@pytest.mark.parametrize("name", ["single-obstacle", "double-obstacle", "moose"])
def test_a_drive_has_the_bits_of_the_one_in_this_process(name, library):
    scene = scene_of(name)
    rows, memory = drive(scene)
    with Component(library, setup_for(scene), scene.obstacles) as component:
        for state, command in rows:
            assert component.step(state) == (OK, command)
        assert component.save() == memory


def test_it_needs_the_c_library_alone_and_shows_its_functions_alone(library_file):
    needed = subprocess.run(["ldd", library_file], capture_output=True, text=True, check=True).stdout
    names = {line.split()[0].rpartition("/")[2].partition(".")[0] for line in needed.splitlines()}
    assert names <= {"linux-vdso", "libm", "libc", "ld-linux-x86-64", "ld-linux-aarch64"}
    shown = subprocess.run(["nm", "-D", "--defined-only", library_file], capture_output=True, text=True, check=True)
    assert all(line.split()[-1].startswith("sidestep_") for line in shown.stdout.splitlines())
    assert "kernel" not in shown.stdout


def test_ten_thousand_steps_take_nothing_from_the_heap(driven, tmp_path):
    scene, rows, _ = driven
    (tmp_path / "setup").write_bytes(setup_for(scene))
    states = np.array([astuple(state) for state, _ in rows])
    (tmp_path / "states").write_bytes(obstacle_rows(scene.obstacles).tobytes() + states.tobytes())
    for name, data in component_files().items():
        (tmp_path / name).write_bytes(data)
    source, library, program = (
        Path(__file__).with_name("count_malloc.c"),
        tmp_path / "libsidestep.so",
        tmp_path / "count",
    )
    files = [tmp_path / name for name in ("arena.c", "controller.c", "kernels.o")]
    compile_library(tmp_path, library, files=files)
    command = ["cc", "-O1", "-pthread", f"-I{tmp_path}", source, library, "-o", program]
    subprocess.run([*command, f"-Wl,-rpath,{tmp_path}"], check=True)
    done = subprocess.run([program, tmp_path / "setup", tmp_path / "states"], capture_output=True, text=True)
    noticed, here, in_a_new_thread, peak = map(int, done.stdout.split())
    assert (noticed, here, in_a_new_thread) == (1, 0, 0)
    assert 0 < peak < 4096 * 1024


def test_memories_go_both_ways_between_it_and_the_controller(driven, library):
    scene, rows, _ = driven
    controller = in_process(scene)
    with Component(library, setup_for(scene), scene.obstacles) as component:
        for state, _ in rows[:30]:
            component.step(state)
        controller.restore(component.save())
        for state, command in rows[30:50]:
            controller.step(state)
            assert command_of(controller) == command
        assert component.restore(controller.save()) == OK
        assert [component.step(state)[1] for state, _ in rows[50:80]] == [command for _, command in rows[50:80]]


def test_a_foreign_or_damaged_memory_is_refused_and_changes_nothing(driven, library):
    scene, rows, memory = driven
    with Component(library, setup_for(scene), scene.obstacles) as component:
        component.step(rows[0][0])
        before = component.save()
        for data in (b"", memory[:-1], memory + b"0", b"sidestap" + memory[8:], memory[:100] + b"\1" + memory[101:],
                     memory[:8] + b"\7" + memory[9:]):  # fmt: skip
            assert component.restore(data) == FOREIGN
            assert component.save() == before
    assert len(memory) == MEMORY_BYTES == library.sidestep_memory_size()


@pytest.mark.parametrize("field", ["x", "v_x", "time"])
def test_a_state_that_is_not_measured_is_answered_from_the_last_plan_and_then_by_a_fault(field, driven, library):
    scene, rows, _ = driven
    controller = in_process(scene)
    with Component(library, setup_for(scene), scene.obstacles) as component:
        for state, _ in rows[:20]:
            component.step(state)
            controller.step(state)
        for k in range(12):
            state = replace(rows[20 + k][0], **{field: math.nan})
            controller.step(state)
            status, command = component.step(state)
            assert (status, command) == (INPUT, command_of(controller))
        assert command[-1] == Status.FAULT


def test_an_obstacle_that_cannot_be_is_as_bad_as_a_state(driven, library):
    scene, rows, _ = driven
    with Component(library, setup_for(scene), scene.obstacles) as component:
        assert component.step(rows[0][0])[0] == OK
        for field, value in (("s", math.nan), ("width", 0.0), ("speed", 1e3), ("time", math.inf), ("length", -1.0)):
            component.obstacles = obstacle_rows(scene.obstacles)
            component.obstacles[field][1] = value
            status, command = component.step(rows[1][0])
            assert (status, command[-1]) == (INPUT, Status.DEGRADED)
        component.obstacles = obstacle_rows([scene.obstacles[0]] * (OBSTACLES + 1))
        assert component.step(rows[1][0])[0] == TOO_MANY
        component.obstacles = obstacle_rows(scene.obstacles)
        assert component.step(rows[1][0])[0] == OK


def test_the_arena_has_room_for_as_many_obstacles_as_there_may_be(driven, library):
    scene, rows, _ = driven
    crowd = [Obstacle(10.0 + k, 3.0 if k % 2 else -3.0, 0.5, 0.5, speed=0.1 * k) for k in range(OBSTACLES)]
    with Component(library, setup_for(scene), crowd) as component:
        for state, _ in rows[:100]:
            assert component.step(state)[0] == OK
        assert component.call("arena_peak") < 4096 * 1024


def test_an_arena_that_is_too_small_is_a_fallback_not_a_crash(driven, tmp_path):
    scene, rows, _ = driven
    for name, data in component_files().items():
        (tmp_path / name).write_bytes(data)
    text = (tmp_path / "controller.c").read_text()
    (tmp_path / "controller.c").write_text(text.replace("ARENA_SIZE = 4096 * 1024", "ARENA_SIZE = 64 * 1024"))
    files = [tmp_path / name for name in ("arena.c", "controller.c", "kernels.o")]
    compile_library(tmp_path, tmp_path / "small.so", files=files)
    with Component(load(tmp_path / "small.so"), setup_for(scene), scene.obstacles) as component:
        assert component.step(rows[0][0])[0] == ARENA
        assert component.answer["status"][0] == Status.FAULT
        assert np.isfinite(component.answer["steer_angle"][0])


def test_where_an_obstacle_was_counts_from_its_own_time(driven, library):
    scene, rows, _ = driven
    moving = [Obstacle(40.0, 0.5, 4.5, 1.8, speed=4.0)]
    with Component(library, setup_for(scene), moving) as one, Component(library, setup_for(scene), moving) as other:
        other.obstacles["s"], other.obstacles["time"] = 48.0, 2.0
        for state, _ in rows[:50]:
            assert one.step(state) == other.step(state)
        states = other.state.ctypes.data, other.obstacles.ctypes.data, 1
        front = scene.vehicle.front_extent
        other.state["time"], other.state["x"], other.state["y"], other.state["yaw"] = 2.0, 0.0, 0.5, 0.0
        assert other.call("clearance", *states) == pytest.approx(48.0 - 2.25 - front, abs=1e-9)


def test_tuning_while_it_runs_is_restoring_into_a_controller_of_other_settings(driven, library):
    scene, rows, _ = driven
    changes = {"buffer": 0.5, "weight_offset": 9.0, "friction": 0.7, "cruise_speed": 13.0, "input_delay_steps": 2}
    with Component(library, setup_for(scene), scene.obstacles) as component:
        for state, _ in rows[:20]:
            component.step(state)
        tuned = in_process(scene, **changes)
        tuned.restore(component.save())
        assert component.tune(**changes) == OK
        for state, _ in rows[20:60]:
            tuned.step(state)
            assert component.step(state) == (OK, command_of(tuned))
        assert component.tune(friction=0.0) == component.tune(friction=math.nan) == RANGE


def test_a_setup_that_is_not_this_versions_is_refused(driven, library):
    scene, _, _ = driven
    setup = setup_for(scene)
    for data, problem in (
        (setup[:50], "too short"), (b"x" + setup[1:], "not a setup"),
        (setup[:8] + b"\0" + setup[9:], "another version"),
        (setup[:-8], "length"), (setup[:-1] + b"\7", "damaged"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=problem):
            Component(library, data)
    assert library.sidestep_abi() == abi()


def test_the_literal_paper_has_no_component():
    scene = scene_of("double-obstacle", "controller.preset=paper")
    with pytest.raises(InputError, match=r"controller\.formulation: 'paper': its solver is not compiled; allowed: cor"):
        setup_for(scene)


def test_many_instances_at_once_in_many_threads(driven, library):
    scene, rows, _ = driven
    instances = [Component(library, setup_for(scene), scene.obstacles) for _ in range(1000)]
    assert all(one.call("instance_size") <= 5 * 1024 * 1024 for one in instances)

    def steps(one):
        return [one.step(state)[1] for state, _ in rows[:5]]

    with ThreadPoolExecutor(4) as pool:
        assert all(found == [command for _, command in rows[:5]] for found in pool.map(steps, instances))
    for one in instances:
        one.call("free")


def test_the_static_library_defines_nothing_that_a_host_may_have(tmp_path):
    (tmp_path / "lib.a").write_bytes(static_library())
    shown = subprocess.run(
        ["nm", "-g", "--defined-only", tmp_path / "lib.a"], capture_output=True, text=True, check=True
    )
    names = [line.split()[-1] for line in shown.stdout.splitlines() if len(line.split()) == 3]
    assert "sidestep_step" in names
    assert [name for name in names if not name.startswith(("sidestep_", "arena_enter"))] == []
