"""`sidestep fmu info` and `sidestep fmu check`: what is in an FMU, a mapping proposed for it, what is wrong with it."""

from pathlib import Path

import pytest
from support.fmus.fmu_files import FOREIGN_MAP, changed, description, patched, reported_here, unpacked

from sidestep.fmu.description.plants import MODELS
from sidestep.fmu.importing.archive import unpack
from sidestep.fmu.importing.checks import findings
from sidestep.fmu.importing.checks.findings import check_fmu
from sidestep.fmu.importing.mapping import Mapping
from sidestep.fmu.importing.proposal import describe, propose_mapping
from sidestep.fmu.native.build import build_fmu
from sidestep.plant_models.errors import InputError


@pytest.fixture
def in_this_process(monkeypatch):
    """The step that a check makes, made here, and no fmutool: both are processes of their own otherwise."""
    monkeypatch.setattr(findings, "reported", reported_here)
    monkeypatch.setattr(findings, "_fmutool", lambda path: [])


def with_description(source, target, *replacements):
    """A copy of an FMU with its modelDescription.xml edited."""
    with unpacked(source) as fmu:
        text = (fmu.folder / "modelDescription.xml").read_text()
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new)
    return changed(source, target, {"modelDescription.xml": text.encode()})


def test_proposed_mapping_is_the_one_that_drives(foreign):
    with unpacked(foreign[0]) as fmu:
        text, proposal = describe(fmu.about), propose_mapping(fmu.about, foreign[0])
    assert "steps by multiples of 0.01 s only" in text
    assert "HandWheel" in text
    found, expected = Mapping.from_text(proposal), Mapping.from_text(FOREIGN_MAP)
    for side in ("inputs", "outputs", "start"):
        for name, row in getattr(expected, side).items():
            theirs = getattr(found, side)[name]
            assert theirs.variable == row.variable
            assert abs(theirs.scale) == pytest.approx(abs(row.scale), rel=1e-12)
    assert found.estimate == ("yaw_rate",)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("fmi", [2, 3])
def test_proposal_for_our_own_fmu_needs_no_edit(model, fmi):
    file = build_fmu(model, fmi)
    with unpacked(file) as fmu:
        proposal, text = Mapping.from_text(propose_mapping(fmu.about, file)), describe(fmu.about)
    assert proposal == Mapping()
    assert "can: variable step, state save, state serialisation, directional derivatives" in text
    assert "default step 0.02 s" in text


def test_proposal_says_what_a_person_has_to_look_at(tmp_path):
    renamed = {"steer_angle_command": "steering", "target_speed": "gas", "steer_offset": "brake", "x": "lambda",
               "v_x": "longitudinalVelocity"}  # fmt: skip
    pairs = [(f'name="{ours}"', f'name="{theirs}"') for ours, theirs in renamed.items()]
    pairs += [('name="steering" valueReference="1"', 'name="steering" min="-1" max="1" valueReference="1"')]
    text = description(3)
    for old, new in pairs:
        text = text.replace(old, new)
    row = next(line for line in text.splitlines() if 'name="brake"' in line)
    text = text.replace(row, row.replace('causality="parameter" variability="tunable"', 'causality="input"'))
    for name in ("steering", "gas", "brake"):
        row = next(line for line in text.splitlines() if f'name="{name}"' in line)
        text = text.replace(row, row.replace(' unit="rad"', "").replace(' unit="m/s"', ""))
    file = changed(build_fmu(), tmp_path / "car.fmu", {"modelDescription.xml": text.encode()})
    with unpacked(file) as fmu:
        proposal = propose_mapping(fmu.about, file)
    assert 'steer_angle = { variable = "steering", full_lock = 0.6 }  # road-wheel angle at 1 [rad]: check' in proposal
    assert 'throttle = { variable = "gas", scale = 3.0 }  # acceleration at full pedal' in proposal
    assert 'brake = { variable = "brake", scale = 8.0 }' in proposal
    assert 'v_x = { variable = "longitudinalVelocity", unit = "m/s" }' in proposal
    assert '# x = "?"  # not found, but needed' in proposal


def test_proposal_without_steering_says_so(tmp_path):
    file = with_description(
        build_fmu(), tmp_path / "car.fmu", ('name="steer_angle_command"', 'name="knob"'), (' stepSize="0.02"', "")
    )
    with unpacked(file) as fmu:
        assert '# steer_angle = "?"  # not found: what steers the car?' in propose_mapping(fmu.about, file)
        assert "default step" not in describe(fmu.about)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("fmi", [2, 3])
def test_nothing_is_found_in_ours(model, fmi, monkeypatch):
    monkeypatch.setattr(findings, "reported", reported_here)
    assert check_fmu(build_fmu(model, fmi)) == []


def test_the_check_runs_the_fmu_in_another_process(tmp_path):
    start = "void model_initialise(double v[]) {"
    dying = patched(tmp_path, 3, start, f"void abort(void);\n{start}\n    abort();")
    assert ("sidestep", "the plant's process ended in fmi3ExitInitializationMode: SIGABRT") in check_fmu(dying)


def test_what_is_no_fmu_is_the_only_finding(tmp_path):
    assert check_fmu(tmp_path / "none.fmu") == [("sidestep", "no such file; allowed: an .fmu file")]


def test_description_and_binary_that_do_not_agree(foreign, tmp_path, in_this_process):
    boast = [("<CoSimulation ", '<CoSimulation canGetAndSetFMUstate="true" '), ('start="0"/></Sc', "/></Sc")]
    found = check_fmu(with_description(foreign[0], tmp_path / "lying.fmu", *boast))
    assert ("sidestep", "it says canGetAndSetFMUstate, but its binary lacks fmi2GetFMUstate") in found
    assert any(who == "sidestep" and "fmi2ExitInitializationMode failed" in what for who, what in found)  # no mode set
    assert any(who == "fmpy" for who, _ in found)


def test_a_description_with_nothing_to_connect_and_no_step(tmp_path, in_this_process):
    file = with_description(
        build_fmu(), tmp_path / "deaf.fmu", ('causality="input"', 'causality="local"'),
        ('causality="output"', 'causality="local"'), ('canHandleVariableCommunicationStepSize="true"', ""),
        (' stepSize="0.02"', ""),
    )  # fmt: skip
    found = [what for who, what in check_fmu(file) if who == "sidestep"]
    assert found[:3] == [
        "it has no input: nothing can be connected", "it has no output: nothing can be connected",
        "it has a fixed step but does not say which",
    ]  # fmt: skip


def test_outputs_that_are_not_finite(tmp_path, in_this_process):
    step = "    data->stale = 1;\n    return OK;"
    file = patched(tmp_path, 3, step, "    data->values[Y] = NAN;\n" + step)
    assert ("sidestep", "output y is nan after the first step") in check_fmu(file)


def test_a_binary_that_is_none(tmp_path, in_this_process):
    with unpacked(build_fmu()) as fmu:
        name = next(str(file.relative_to(fmu.folder)) for file in fmu.folder.glob("binaries/*/*"))
    ((who, what), *_) = check_fmu(changed(build_fmu(), tmp_path / "junk.fmu", {name: b"junk"}))
    assert who == "sidestep"
    assert "its binary cannot be loaded" in what


def test_checkers_that_fail_or_are_not_there(monkeypatch):
    assert findings._fmpy(Path("none.fmu")) != []
    monkeypatch.setattr(findings.importlib.util, "find_spec", lambda name: None)
    assert findings._fmutool(build_fmu()) == []


def test_a_step_size_that_is_no_number(tmp_path):
    file = with_description(
        build_fmu(), tmp_path / "step.fmu", ('canHandleVariableCommunicationStepSize="true"', ""),
        ('stepSize="0.02"', 'stepSize="short"'),
    )  # fmt: skip
    with pytest.raises(InputError, match=r"its step size is 'short'; allowed: a number|cannot be read"):
        unpack(file)
