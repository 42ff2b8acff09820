"""Descriptions of a faulty bus: files, what is wrong in them, and netem's arguments for the same."""

from dataclasses import fields

import pytest

from sidestep.controller.can_port.bus.faults import FaultSpec
from sidestep.plant_models.errors import InputError


def test_spec_from_a_file(tmp_path):
    file = tmp_path / "faults.toml"
    file.write_text('seed = 7\nonly = "STEER_CMD"\nloss = 0.2\ndelay = 1\nfreeze = true\nflood = 3\n')
    assert FaultSpec.from_file(file) == FaultSpec(seed=7, only="STEER_CMD", loss=0.2, delay=1, freeze=True, flood=3)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("los = 0.1", r"faults\.toml: los: unknown key; allowed: seed, only,"),
        ("loss = 1.1", r"faults\.loss: 1\.1; allowed: 0 to 1"),
        ("loss = -0.1", r"faults\.loss: -0\.1; allowed: 0 to 1"),
        ("loss = nan", r"faults\.loss: nan; allowed: 0 to 1"),
        ("loss = true", r"faults\.loss: True; allowed: a number"),
        ('loss = "much"', r"faults\.loss: 'much'; allowed: a number"),
        ("freeze = 1", r"faults\.freeze: 1; allowed: true or false"),
        ("flood = 1.5", r"faults\.flood: 1\.5; allowed: a whole number"),
        ("burst = 0", r"faults\.burst: 0; allowed: 1 to 10000"),
        ("delay = inf", r"faults\.delay: inf; allowed: 0 to 10 s"),
        ("start = 1e308", r"faults\.start: 1e\+308; allowed: 0 to 1e\+06 s"),
        ("flood = 100000", r"faults\.flood: 100000; allowed: 0 to 1000"),
        ("stuck = 0", r"faults\.stuck: 0; allowed: true or false"),
        ("only = 1", r"faults\.only: 1; allowed: a text"),
        ("start = 2.0\nend = 1.0", r"faults\.end: 1\.0 s; allowed: > start"),
        ('only = "STEER"', r"faults\.only: unknown message 'STEER'; allowed: STEER_CMD, "),
        ("loss = ", r"faults\.toml: no readable TOML file \(Invalid value"),
    ],
)
def test_bad_specs(text, problem, tmp_path):
    (tmp_path / "faults.toml").write_text(text)
    with pytest.raises(InputError, match=problem):
        FaultSpec.from_file(tmp_path / "faults.toml")


def test_missing_file(tmp_path):
    with pytest.raises(InputError, match="No such file"):
        FaultSpec.from_file(tmp_path / "none.toml")


def test_netem_arguments():
    assert FaultSpec(loss=0.2, duplication=0.05, corruption=0.1, delay=0.02, jitter=0.01).netem_arguments() == (
        ["loss", "20%", "duplicate", "5%", "corrupt", "10%", "delay", "25ms", "5ms"]
    )
    assert FaultSpec(reorder=0.2).netem_arguments() == ["delay", "30ms", "reorder", "80%"]
    assert FaultSpec().netem_arguments() == []


def test_what_netem_cannot_do_is_refused():
    changed = {"only": "STEER_CMD", "start": 1.0, "end": 2.0, "burst": 2, "wrong_length": 0.1, "masquerade": 0.1,
               "counter_jump": 0.1, "freeze": True, "stuck": True, "flood": 1}  # fmt: skip
    assert set(changed) | {"seed", "loss", "duplication", "delay", "jitter", "reorder", "corruption"} == {
        f.name for f in fields(FaultSpec)
    }
    for name, value in changed.items():
        with pytest.raises(InputError, match=f"netem has no {name}"):
            FaultSpec(**{name: value}).netem_arguments()
    with pytest.raises(InputError, match="reorder, or delay and jitter"):
        FaultSpec(reorder=0.1, delay=0.1).netem_arguments()
