"""Controller and plant in masters that others wrote: the same drive as in our own loop with the same coupling."""

import io
import json
import os
import subprocess
import sys
import zipfile
from concurrent.futures import ThreadPoolExecutor

import fmpy
import numpy as np
import pytest
from fmpy.ssp.simulation import simulate_ssp

from sidestep.controller import ControllerConfig, SteeringController
from sidestep.fmu.exporting.controller_variables import STATE
from sidestep.fmu.exporting.export import export_controller, start_plant
from sidestep.fmu.exporting.ssp import write_ssp
from sidestep.fmu.native.plant import native_plant
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.validation.scenarios.scenario import load_scenario

SCENE = load_scenario("single-obstacle", ["controller.input_delay_steps=1", "controller.solver=active-set"])
NAMES = [name for name, *_ in STATE]
COMMANDS = ("steer_angle_command", "target_speed", "acceleration")
STEPS, PERIOD = 80, SCENE.controller.period


def pair(fmi):
    scene = SCENE
    controller = export_controller(
        scene.name, scene.vehicle, scene.path, scene.obstacles, scene.controller, scene.start, fmi
    )
    return controller, start_plant("single-track", scene.vehicle, scene.start, fmi=fmi)


def our_loop(delayed, command=None, seen=None):
    """Lateral positions at every period, and of what is in force and seen first: None for u(t0) and x(t0)."""
    controller = SteeringController(SCENE.vehicle, SCENE.path, SCENE.obstacles, SCENE.controller)
    with native_plant(SCENE.vehicle) as plant:
        state = plant.reset(SCENE.start)
        rows = [state.y]
        for _ in range(STEPS):
            answer = controller.step(seen or state)
            seen, command = None, (command if delayed and command else answer)
            state = plant.step(command, PERIOD)
            command = answer
            rows.append(state.y)
    return np.array(rows)


@pytest.mark.parametrize("sequential", [False, True], ids=["one-step-delay", "zero-delay"])
@pytest.mark.parametrize("fmi", [2, 3])
def test_both_inside_one_container_fmu(fmi, sequential, tmp_path):
    for name, file in zip(("controller", "plant"), pair(fmi), strict=True):
        (tmp_path / f"{name}.fmu").write_bytes(file.read_bytes())
    links = [["plant.fmu", name, "controller.fmu", name] for name in NAMES]
    links += [["controller.fmu", name, "plant.fmu", name] for name in COMMANDS]
    container = {
        "name": "pair.fmu", "fmu": ["controller.fmu", "plant.fmu"], "step_size": PERIOD, "sequential": sequential,
        "link": links, "output": [["plant.fmu", "y", "y"]], "auto_link": False, "auto_input": False,
        "auto_output": False, "auto_parameter": False, "auto_local": False, "mt": False, "profiling": False,
    }  # fmt: skip
    (tmp_path / "pair.json").write_text(json.dumps(container))
    code = "from fmu_manipulation_toolbox.cli.fmucontainer import fmucontainer; fmucontainer()"
    subprocess.run(
        [sys.executable, "-c", code, "-container", "pair.json", "-fmu-directory", str(tmp_path), "-fmi", str(fmi)],
        cwd=tmp_path, check=True, capture_output=True,
    )  # fmt: skip
    result = fmpy.simulate_fmu(
        str(tmp_path / "pair.fmu"), stop_time=STEPS * PERIOD, step_size=PERIOD, output_interval=PERIOD,
        logger=lambda *_: None,
    )  # fmt: skip
    np.testing.assert_allclose(result["y"], our_loop(not sequential), rtol=0, atol=1e-9)


def test_libcosim_runs_the_pair_of_fmi_2(tmp_path):
    files = pair(2)
    references = [{v.name: v.valueReference for v in fmpy.read_model_description(f).modelVariables} for f in files]
    links = [(1, 0, name) for name in NAMES] + [(0, 1, name) for name in COMMANDS]
    program = f"""
import json
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave

run = CosimExecution.from_step_size({round(PERIOD * 1e9)})
slaves = [run.add_local_slave(CosimLocalSlave(file, name)) for name, file in zip("cp", {[str(f) for f in files]!r})]
references = {references!r}
for start, end, name in {links!r}:
    run.connect_real_variables(slaves[start], references[start][name], slaves[end], references[end][name])
observer, rows = CosimObserver.create_last_value(), []
run.add_observer(observer)
for _ in range({STEPS}):
    run.step()
    rows.append(observer.last_real_values(slaves[1], [references[1]["y"]])[0])
open({str(tmp_path / "rows.json")!r}, "w").write(json.dumps(rows))
"""  # in a process of its own: it logs to standard output
    subprocess.run([sys.executable, "-c", program], check=True, capture_output=True)
    rows = json.loads((tmp_path / "rows.json").read_text())
    np.testing.assert_allclose(rows, our_loop(True)[1:], rtol=0, atol=1e-9)


def test_fmpy_opens_the_system_file(tmp_path):
    file = write_ssp(tmp_path / "drive.ssp", "drive", *pair(2), duration=8.0, period=PERIOD)
    result = simulate_ssp(str(file), stop_time=(STEPS - 0.5) * PERIOD, step_size=PERIOD)
    zeros = SteeringCommand(0.0, 0.0, 0.0, acceleration=0.0), VehicleState()  # handed over in its first step
    np.testing.assert_allclose(result["plant.y"], our_loop(True, *zeros)[1:], rtol=0, atol=1e-9)


def test_system_file_that_cannot_be_written(tmp_path):
    with pytest.raises(InputError, match=r"no/drive\.ssp: cannot be written"):
        write_ssp(tmp_path / "no" / "drive.ssp", "drive", *pair(2), duration=8.0, period=PERIOD)


def test_a_pipe_takes_the_system_file_and_stays_one(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with ThreadPoolExecutor() as pool:
        read = pool.submit(pipe.read_bytes)
        write_ssp(pipe, "drive", *pair(2), duration=8.0, period=PERIOD)
        assert zipfile.ZipFile(io.BytesIO(read.result(10.0))).testzip() is None
    assert pipe.is_fifo()


def last_second(preset, delayed, delay_steps, period=0.1):
    """Largest lateral offset in the last of six seconds at 25 m/s, from 1.5 m off a free road, in [m]."""
    config = ControllerConfig.preset(preset, period=period, input_delay_steps=delay_steps, cruise_speed=25.0)
    controller, command, rows = SteeringController(SCENE.vehicle, SCENE.path, (), config), None, []
    with native_plant(SCENE.vehicle) as plant:
        state = plant.reset(VehicleState(y=1.5, v_x=25.0))
        for _ in range(round(6.0 / period)):
            answer = controller.step(state)
            command = command if delayed and command else answer
            state, command = plant.step(command, period), answer
            rows.append(abs(state.y))
    return max(rows[-round(1.0 / period) :])


def test_one_step_of_delay_ruins_the_controller_of_the_paper_and_its_compensation_cures_it():
    assert last_second("paper", delayed=False, delay_steps=0) < 1e-3
    assert last_second("paper", delayed=True, delay_steps=0) > 1.0
    assert last_second("paper", delayed=True, delay_steps=1) < 1e-3


def test_the_default_controller_stands_one_step_of_delay_either_way():
    for delay_steps in (0, 1):
        assert last_second("default", delayed=True, delay_steps=delay_steps) < 5e-3
