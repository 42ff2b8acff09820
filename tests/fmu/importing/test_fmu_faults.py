"""Faults of FMUs, of mappings and of their users: clear errors, and nothing left behind."""

import gc
import math
import os
import re
import subprocess
import sys
import tempfile
from dataclasses import replace

import pytest
from fmpy.fmi1 import FMICallException
from support.fmus.fmu_files import CAR, QUICK, START, binary, changed, description, patched, slalom

from sidestep.fmu.compiling.platforms import compile_library
from sidestep.fmu.importing.mapping import Mapping, Signal
from sidestep.fmu.importing.plant import FmuPlant
from sidestep.fmu.native.build import build_fmu
from sidestep.fmu.native.plant import native_plant
from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.signals import SteeringCommand


@pytest.fixture(autouse=True)
def unpacked(tmp_path, monkeypatch):
    """Folder in which FMUs are unpacked: empty when all is closed."""
    folder = tmp_path / "unpacked"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def names(folder):
    return [file.name for file in folder.iterdir()]


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
    with pytest.raises(InputError, match=r"none\.toml: cannot be read .No such file"):
        FmuPlant.from_file(build_fmu(), tmp_path / "none.toml")


def test_mapping_to_variables_that_are_not_there(unpacked):
    with pytest.raises(InputError, match="no variable 'gamma' in it; allowed: time, steer_angle_command"):
        FmuPlant.from_file(build_fmu(), Mapping(outputs=Mapping().outputs | {"yaw_rate": Signal("gamma")}))
    with pytest.raises(InputError, match="no variable 'colour'"):
        native_plant(CAR, colour=3.0)
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
        "elsewhere.fmu": (
            {
                binary(fmi): None,
                "binaries/win64/a.dll": b"",
                "sources/buildDescription.xml": None,
                "modelDescription.xml": re.sub("<SourceFiles>.*</SourceFiles>", "", text, flags=re.DOTALL).encode(),
            },
            "no binary for .* but for: win64",
        ),
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
    with native_plant(CAR, fmi=fmi, friction=-1.0) as plant, pytest.raises(PlantError) as caught:
        plant.reset(START)
    assert "Set" in str(caught.value)
    assert "status 3 (error); friction must be at least 0, not -1" in str(caught.value)


def test_discarded_step_names_function_status_and_time(fmi):
    with native_plant(CAR, fmi=fmi, mass=1.0, yaw_inertia=1.0, internal_step=1.0) as plant:
        plant.reset(START)
        with pytest.raises(PlantError, match=rf"fmi{fmi}DoStep failed at t = .* status 2 \(discard\); \w+ diverged"):
            slalom(plant, steps=1000, dt=1.0)
        with pytest.raises(PlantError, match="step before reset"):
            plant.step(SteeringCommand(0.0, 0.0, 15.0), 0.02)
        assert plant.reset(START) == START


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
    compile_library(tmp_path / "sources", tmp_path / "binary", QUICK)
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
    with native_plant(CAR, fmi=fmi) as plant:
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
    plant = native_plant(CAR)
    assert len(names(unpacked)) == 1
    plant.reset(START)
    plant.close()
    plant.close()
    with pytest.raises(PlantError, match="before reset"):
        plant.step(SteeringCommand(0.0, 0.0, 15.0), 0.02)
    forgotten = native_plant(CAR)
    forgotten.reset(START)
    del forgotten
    gc.collect()
    assert names(unpacked) == []


def test_interpreter_exit_removes_what_was_unpacked(unpacked):
    program = (
        "import os\n"
        "from sidestep.fmu.native.plant import native_plant\n"
        "from sidestep.plant_models.signals import VehicleState\n"
        "from sidestep.plant_models.vehicle.parameters import VehicleParameters\n"
        "plant = native_plant(VehicleParameters.preset('bmw-320i'))\n"
        "plant.reset(VehicleState(v_x=10.0))\n"
        "print(len(os.listdir(os.environ['TMPDIR'])))\n"
    )
    environment = os.environ | {"TMPDIR": str(unpacked)}
    run = subprocess.run([sys.executable, "-c", program], env=environment, check=True, capture_output=True, text=True)
    assert run.stdout == "1\n"
    assert names(unpacked) == []
