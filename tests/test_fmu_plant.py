"""FmuPlant: any FMU as a plant, its faults as clear errors."""

import gc
import math
import os
import subprocess
import sys
import tempfile
import zipfile
from dataclasses import astuple, replace

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from sidestep.fmu.build import build_fmu, compile_library
from sidestep.fmu.fmu_plant import FmuPlant
from sidestep.fmu.mapping import Mapping, Signal
from sidestep.plant_models.check_plant import check_plant
from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.plant import Plant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.vehicle import VehicleParameters

CAR = VehicleParameters.preset("bmw-320i")
START = VehicleState(time=1.0, x=2.0, y=3.0, yaw=0.4, v_x=15.0, v_y=0.1, yaw_rate=0.05, steer_angle=0.01)


@pytest.fixture(autouse=True)
def unpacked(tmp_path, monkeypatch):
    """Folder in which FMUs are unpacked: empty when all is closed."""
    folder = tmp_path / "unpacked"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def names(folder):
    return [file.name for file in folder.iterdir()]


@pytest.fixture(params=[2, 3], ids=["FMI2", "FMI3"])
def fmi(request):
    return request.param


@pytest.fixture
def plant(fmi):
    with FmuPlant.native(CAR, fmi=fmi) as plant:
        yield plant


def slalom(plant, steps=100, dt=0.02):
    rows = [plant.step(SteeringCommand(0.0, 0.1 * math.sin(0.1 * k), 12.0), dt) for k in range(steps)]
    return np.array([astuple(row) for row in rows])


def changed(source, target, changes):
    """A copy of an FMU with the bytes of some of its files replaced; None removes one."""
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            data = changes.get(name, old.read(name))
            if data is not None:
                new.writestr(name, data)
        for name in changes.keys() - set(old.namelist()):
            new.writestr(name, changes[name])
    return target


def description(fmi):
    with zipfile.ZipFile(build_fmu(fmi=fmi)) as archive:
        return archive.read("modelDescription.xml").decode()


def binary(fmi):
    platform = fmpy.platform if fmi == 2 else fmpy.platform_tuple
    return f"binaries/{platform}/single_track{fmpy.sharedLibraryExtension}"


def test_it_is_a_plant(plant):
    assert isinstance(plant, Plant)
    assert check_plant(plant, CAR) == []


def test_reset_puts_the_car_there_again_and_again(plant):
    assert plant.reset(START) == START
    first = slalom(plant)
    assert plant.reset(START) == START
    np.testing.assert_array_equal(slalom(plant), first)


def test_both_standards_give_the_same_bits():
    rows = []
    for fmi in (2, 3):
        with FmuPlant.native(CAR, fmi=fmi) as plant:
            plant.reset(START)
            rows.append(slalom(plant))
    np.testing.assert_array_equal(*rows)


def test_instances_do_not_know_of_each_other(fmi):
    with FmuPlant.native(CAR, fmi=fmi) as alone:
        alone.reset(START)
        expected = slalom(alone)
    with FmuPlant.native(CAR, fmi=fmi) as one, FmuPlant.native(CAR, friction=0.3, fmi=fmi) as other:
        one.reset(START)
        other.reset(replace(START, v_x=25.0))
        rows = []
        for k in range(100):
            command = SteeringCommand(0.0, 0.1 * math.sin(0.1 * k), 12.0)
            rows.append(astuple(one.step(command, 0.02)))
            other.step(command, 0.01)
    np.testing.assert_array_equal(rows, expected)


def test_serialised_state_goes_back_to_the_last_bit(plant):
    plant.reset(START)
    slalom(plant)
    fmu = plant._fmu._slave
    state = fmu.getFMUState()
    data = fmu.serializeFMUState(state)
    here, clock = plant._state(), (plant._time, plant._steps, plant._origin)
    first = slalom(plant)
    fmu.freeFMUState(state)
    state = fmu.deserializeFMUState(data)
    fmu.setFMUState(state)
    fmu.freeFMUState(state)
    plant._time, plant._steps, plant._origin = clock
    assert plant._state() == here
    np.testing.assert_array_equal(slalom(plant), first)


def test_foreign_serialised_state_is_refused(plant):
    plant.reset(START)
    fmu = plant._fmu._slave
    state = fmu.getFMUState()
    data = fmu.serializeFMUState(state)
    fmu.freeFMUState(state)
    for foreign in (data[:-8], b"x" + data[1:]):
        with pytest.raises(FMICallException):
            fmu.deserializeFMUState(foreign)
        assert "another build" in plant._fmu._messages[-1]


def test_time_does_not_drift(plant):
    plant.reset(START)
    for k in range(1, 2001):
        state = plant.step(SteeringCommand(0.0, 0.0, 15.0), 0.1)
        assert state.time == 1.0 + k * 0.1
    assert plant.step(SteeringCommand(0.0, 0.0, 15.0), 0.03).time == 1.0 + 2000 * 0.1 + 0.03


def test_command_that_is_not_finite_keeps_the_last_one(plant):
    plant.reset(START)
    plant.step(SteeringCommand(0.0, 0.05, 10.0), 0.02)
    kept = plant.step(SteeringCommand(0.0, math.nan, math.inf), 0.02)
    plant.reset(START)
    plant.step(SteeringCommand(0.0, 0.05, 10.0), 0.02)
    assert plant.step(SteeringCommand(0.0, 0.05, 10.0), 0.02) == kept


def test_fmu_itself_ignores_an_input_that_is_not_a_number(plant):
    plant.reset(START)
    plant._inputs.values[:] = [math.nan, 12.0]
    plant._fmu.set(plant._inputs)  # a warning, no error
    port = plant._fmu.port(["steer_angle_command", "target_speed"])
    plant._fmu.get(port)
    assert list(port.values) == [START.steer_angle, 12.0]


def test_renamed_and_scaled_variables(fmi, tmp_path):
    text = description(fmi)
    for ours, theirs in {"yaw_rate": "psi_dot", "steer_angle_command": "Delta.cmd", "v_x_0": "v0"}.items():
        text = text.replace(f'name="{ours}"', f'name="{theirs}"')
    foreign = changed(build_fmu(fmi=fmi), tmp_path / "foreign.fmu", {"modelDescription.xml": text.encode()})
    table = tmp_path / "map.toml"
    table.write_text(
        '[inputs]\nsteer_angle = { variable = "Delta.cmd", scale = -0.5, offset = 0.01 }\n'
        '[outputs]\nyaw_rate = { variable = "psi_dot", scale = 0.017453292519943295 }\n'
        '[start]\nv_x = "v0"\n[parameters]\nfriction = 0.7\n'
    )
    with FmuPlant.from_file(foreign, table) as plant, FmuPlant.native(CAR, friction=0.7) as own:
        plant.reset(VehicleState(v_x=15.0, steer_angle=0.01))
        own.reset(VehicleState(v_x=15.0))
        for _ in range(50):
            found = plant.step(SteeringCommand(0.0, -0.02, 15.0), 0.02)
            expected = own.step(SteeringCommand(0.0, 0.06, 15.0), 0.02)
    assert found.yaw_rate == pytest.approx(math.radians(expected.yaw_rate), rel=1e-12)
    assert replace(found, yaw_rate=0.0) == replace(expected, yaw_rate=0.0)


def test_own_fmu_from_a_file_takes_the_vehicle():
    van = VehicleParameters.preset("vw-vanagon")
    with FmuPlant.from_file(build_fmu(), vehicle=van) as plant, FmuPlant.native(van) as native:
        plant.reset(START)
        native.reset(START)
        np.testing.assert_array_equal(slalom(plant), slalom(native))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[outputs]\nyawrate = 'a'", "unknown key 'yawrate'; allowed: x, y, yaw"),
        ("[input]\n", "unknown key 'input'; allowed: inputs, outputs, start, parameters"),
        ("inputs = 3", "inputs: 3 is not a table"),
        ("[start]\nx = 3", "start.x: 3 names no variable"),
        ("[start]\nx = {variable = 'a', factor = 2}", "start.x: unknown key 'factor'"),
        ("[outputs]\nx = {variable = 'a', scale = 0}", r"outputs.x.scale: 0; allowed: any other number"),
        ("[outputs]\nx = {variable = 'a', offset = 'b'}", "outputs.x.offset: 'b'; allowed: a finite number"),
        ("[parameters]\nmass = nan", "parameters.mass: nan; allowed: a finite number"),
        ("[outputs", "map.toml: "),
    ],
)
def test_bad_mapping_file(text, message, tmp_path):
    file = tmp_path / "map.toml"
    file.write_text(text)
    with pytest.raises(InputError, match=message):
        Mapping.from_file(file)


def test_missing_mapping_file(tmp_path):
    with pytest.raises(InputError, match=r"none\.toml: No such file"):
        FmuPlant.from_file(build_fmu(), tmp_path / "none.toml")


def test_mapping_to_variables_that_are_not_there(unpacked):
    with pytest.raises(InputError, match="no variable 'gamma' in it; allowed: time, steer_angle_command"):
        FmuPlant.from_file(build_fmu(), Mapping(outputs=Mapping().outputs | {"yaw_rate": Signal("gamma")}))
    with pytest.raises(InputError, match="no variable 'colour'"):
        FmuPlant.native(CAR, colour=3.0)
    assert names(unpacked) == []


def test_variable_that_is_no_double(tmp_path):
    text = description(3).replace('<Float64 name="x"', '<Int32 name="x"')
    foreign = changed(build_fmu(), tmp_path / "whole.fmu", {"modelDescription.xml": text.encode()})
    with pytest.raises(InputError, match="'x' is of type Int32; allowed: Real, Float64"):
        FmuPlant.from_file(foreign)


def broken_fmus(folder, fmi):
    whole = build_fmu(fmi=fmi)
    text = description(fmi)
    only_me = text.replace("<CoSimulation", "<ModelExchange").replace("</CoSimulation", "</ModelExchange")
    only_me = only_me.replace('canHandleVariableCommunicationStepSize="true"', "")
    (folder / "text.fmu").write_text("hello")
    (folder / "truncated.fmu").write_bytes(whole.read_bytes()[:20_000])
    data = bytearray(whole.read_bytes())
    data[len(data) // 2] ^= 0xFF
    (folder / "damaged.fmu").write_bytes(data)
    yield folder / "missing.fmu", "no such file"
    yield folder, "no such file"
    yield folder / "text.fmu", "not an FMU, or a truncated one"
    yield folder / "truncated.fmu", "not an FMU, or a truncated one"
    yield folder / "damaged.fmu", "damaged|truncated"
    changes = {
        "no-xml.fmu": ({"modelDescription.xml": None}, "no modelDescription.xml"),
        "bad-xml.fmu": ({"modelDescription.xml": b"<fmi"}, "modelDescription.xml cannot be read"),
        "fmi1.fmu": ({"modelDescription.xml": b'<a fmiVersion="1.0"/>'}, "modelDescription.xml cannot be read|FMI 1"),
        "me.fmu": ({"modelDescription.xml": only_me.encode()}, "model exchange only"),
        "slip.fmu": ({"../evil": b""}, "unsafe path '../evil'"),
        "drive.fmu": ({"C:/evil": b""}, "unsafe path"),
        "elsewhere.fmu": ({binary(fmi): None, "binaries/win64/a.dll": b""}, "no binary for .* but for: win64"),
        "junk.fmu": ({binary(fmi): b"junk"}, "its binary cannot be loaded"),
    }
    for name, (change, problem) in changes.items():
        yield changed(whole, folder / name, change), problem


def test_broken_fmus_are_named_and_leave_nothing_behind(fmi, tmp_path, unpacked):
    directory = os.getcwd()
    for path, problem in broken_fmus(tmp_path, fmi):
        with pytest.raises(InputError, match=problem) as caught:
            FmuPlant.from_file(path)
        assert str(path) in str(caught.value)
        assert "\n" not in str(caught.value)
    assert names(unpacked) == []
    assert os.getcwd() == directory


def test_binary_of_another_description_is_refused(fmi, tmp_path):
    token = "guid" if fmi == 2 else "instantiationToken"
    text = description(fmi).replace(f'{token}="', f'{token}="0')
    other = changed(build_fmu(fmi=fmi), tmp_path / "other.fmu", {"modelDescription.xml": text.encode()})
    with FmuPlant.from_file(other) as plant, pytest.raises(PlantError, match="belongs to another"):
        plant.reset(START)


def test_refused_parameter_says_why(fmi):
    with FmuPlant.native(CAR, fmi=fmi, friction=-1.0) as plant, pytest.raises(PlantError) as caught:
        plant.reset(START)
    assert "Set" in str(caught.value)
    assert "status 3 (error); friction must be at least 0, not -1" in str(caught.value)


def test_discarded_step_names_function_status_and_time(fmi):
    with FmuPlant.native(CAR, fmi=fmi, mass=1.0, yaw_inertia=1.0, internal_step=1.0) as plant:
        plant.reset(START)
        with pytest.raises(PlantError, match=rf"fmi{fmi}DoStep failed at t = .* status 2 \(discard\); \w+ diverged"):
            slalom(plant, steps=1000, dt=1.0)
        with pytest.raises(PlantError, match="step before reset"):
            plant.step(SteeringCommand(0.0, 0.0, 15.0), 0.02)
        assert plant.reset(START) == START


def patched(folder, fmi, old, new):
    """Our FMU with one line of its C sources replaced and compiled again."""
    sources = folder / "sources"
    with zipfile.ZipFile(build_fmu(fmi=fmi)) as archive:
        for name in archive.namelist():
            if name.startswith("sources/"):
                archive.extract(name, folder)
    file = next(file for file in sources.glob("*.c") if old in file.read_text())
    file.write_text(file.read_text().replace(old, new))
    compile_library(sources, folder / "binary")
    return changed(build_fmu(fmi=fmi), folder / "patched.fmu", {binary(fmi): (folder / "binary").read_bytes()})


def test_output_that_is_not_finite_is_named(tmp_path):
    lying = patched(tmp_path, 3, "data->stale = 1;\n    return OK;", "data->values[YAW_RATE] = NAN;\n    return OK;")
    with FmuPlant.from_file(lying) as plant:
        plant.reset(START)
        with pytest.raises(PlantError, match=r"patched\.fmu: yaw_rate is not finite at t = 1\.02 s"):
            plant.step(SteeringCommand(0.0, 0.0, 15.0), 0.02)


def test_no_call_after_a_fatal_status(tmp_path):
    dying = patched(tmp_path, 2, "void fmi2FreeInstance(fmi2Component c) { instance_free(c); }",
                    "void fmi2FreeInstance(fmi2Component c) { (void)c; abort(); }")  # fmt: skip
    file = tmp_path / "sources" / "fmi2.c"
    file.write_text(file.read_text().replace("return (fmi2Status)do_step(c, time, duration);", "return fmi2Fatal;"))
    compile_library(tmp_path / "sources", tmp_path / "binary")
    changed(dying, tmp_path / "fatal.fmu", {binary(2): (tmp_path / "binary").read_bytes()})
    with FmuPlant.from_file(tmp_path / "fatal.fmu") as plant:
        plant.reset(START)
        with pytest.raises(PlantError, match=r"fatal\.fmu: fmi2DoStep failed at t = 1 s: status 4 \(fatal\)"):
            plant.step(SteeringCommand(0.0, 0.0, 15.0), 0.02)


def test_an_fmu_that_ends_the_simulation(tmp_path):
    ending = patched(
        tmp_path, 3, "*event = *end = *early = fmi3False;", "*event = *early = fmi3False, *end = fmi3True;"
    )
    with FmuPlant.from_file(ending) as plant:
        plant.reset(START)
        with pytest.raises(PlantError, match="ended the simulation"):
            plant.step(SteeringCommand(0.0, 0.0, 15.0), 0.02)


def test_misuse(plant):
    with pytest.raises(PlantError, match="step before reset"):
        plant.step(SteeringCommand(0.0, 0.0, 15.0), 0.02)
    with pytest.raises(PlantError, match="not finite"):
        plant.reset(replace(START, x=math.nan))
    plant.reset(START)
    for dt in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(InputError, match=r"dt: .* s; allowed: > 0"):
            plant.step(SteeringCommand(0.0, 0.0, 15.0), dt)


def test_fmi_calls_out_of_place(fmi):
    with FmuPlant.native(CAR, fmi=fmi) as plant:
        plant.reset(START)
        fmu, messages = plant._fmu._slave, plant._fmu._messages
        set_values, get_values = (fmu.setReal, fmu.getReal) if fmi == 2 else (fmu.setFloat64, fmu.getFloat64)
        variables = plant._fmu.variables
        calls = {
            "x is not an input": lambda: set_values([variables["x"].valueReference], [1.0]),
            "mass must be a finite": lambda: set_values([variables["mass"].valueReference], [math.nan]),
            "x_0 must not be set between steps": lambda: set_values([variables["x_0"].valueReference], [1.0]),
            "no variable with value reference 999": lambda: get_values([999]),
            "must be positive": lambda: fmu.doStep(1.0, 0.0),
            "but the model is at 1 s": lambda: fmu.doStep(7.0, 0.02),
            "must not be called between steps": fmu.exitInitializationMode,
            "is not a known": lambda: fmu.getDirectionalDerivative([3], [variables["der(x)"].valueReference], [1.0]),
            "is not supported": lambda: fmu.getString([0]),
        }
        for message, call in calls.items():
            with pytest.raises(FMICallException):
                call()
            assert message in messages[-1]


def test_closing_removes_what_was_unpacked(unpacked):
    plant = FmuPlant.native(CAR)
    assert len(names(unpacked)) == 1
    plant.reset(START)
    plant.close()
    plant.close()
    with pytest.raises(PlantError, match="before reset"):
        plant.step(SteeringCommand(0.0, 0.0, 15.0), 0.02)
    forgotten = FmuPlant.native(CAR)
    forgotten.reset(START)
    del forgotten
    gc.collect()
    assert names(unpacked) == []


def test_interpreter_exit_removes_what_was_unpacked(unpacked):
    program = (
        "import os\n"
        "from sidestep.fmu.fmu_plant import FmuPlant\n"
        "from sidestep.plant_models.signals import VehicleState\n"
        "from sidestep.plant_models.vehicle import VehicleParameters\n"
        "plant = FmuPlant.native(VehicleParameters.preset('bmw-320i'))\n"
        "plant.reset(VehicleState(v_x=10.0))\n"
        "print(len(os.listdir(os.environ['TMPDIR'])))\n"
    )
    environment = os.environ | {"TMPDIR": str(unpacked)}
    run = subprocess.run([sys.executable, "-c", program], env=environment, check=True, capture_output=True, text=True)
    assert run.stdout == "1\n"
    assert names(unpacked) == []
