"""Somebody else's databases: read as they are, and a mapping file proposed for them."""

import cantools.database
import pytest
from support.can_port.foreign_dbc import DBC

from sidestep.controller.can_port.codec.catalogue import mapped_bus
from sidestep.controller.can_port.codec.foreign import load_database
from sidestep.controller.can_port.codec.proposal import proposed
from sidestep.plant_models.errors import InputError


@pytest.mark.parametrize(("change", "remark"), [
    (("deg", "\u00b0"), None),
    (("BO_ 304", "BO_ 403"), None),
    (("SG_ State : 16", "SG_ 0_State : 16"), "Invalid syntax"),
    (("SG_ Vel : 24", "SG_ Vel : 20"), "overlap"),
    (("BO_ 288 ", "BO_ 419324928 "), "more than 11 bits"),
    (("BU_: A B\n", 'BU_: A B\nCM_ 145 "no kind";\n'), "left out: CM_ 145"),
])  # fmt: skip
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252"])
def test_databases_as_they_are(tmp_path, change, remark, encoding):
    file = tmp_path / "a.dbc"
    file.write_bytes(DBC.replace(*change).encode(encoding))
    database, remarks = load_database(file)
    assert len(database.messages) == 3
    assert (remark in remarks) if remark else remarks == ""


@pytest.mark.parametrize("kind", ["kcd", "sym", "arxml"])
def test_other_formats_come_in(tmp_path, kind):
    database = cantools.database.load_string(DBC, "dbc")
    if kind == "arxml":
        (tmp_path / "a.arxml").write_text("<?xml version='1.0'?><AUTOSAR/>")
        with pytest.raises(InputError, match=r"a\.arxml: cannot be read"):
            load_database(tmp_path / "a.arxml")
        return
    cantools.database.dump_file(database, str(tmp_path / f"a.{kind}"))
    again, _ = load_database(tmp_path / f"a.{kind}")
    assert {message.name for message in again.messages} == {"MOTOROLA", "LONG", "BACK"}


# --- proposals


def test_a_proposal_is_a_mapping_file(tmp_path):
    file = tmp_path / "a.dbc"
    file.write_text(DBC.replace("BO_ 304", "BO_ 513"))
    text = proposed(load_database(file)[0], file)
    (tmp_path / "bus.toml").write_text(text)
    described = mapped_bus(str(tmp_path / "bus.toml"))
    assert described.messages["STEER_CMD"].name in ("MOTOROLA", "LONG")
    assert "feedback[0] BACK" in described.messages
    assert described.messages["VEH_DYN"].frame_id != 513
    assert 'rule = "sum"' in text or "Curve_VZ" in text


def test_nothing_that_steers(tmp_path):
    file = tmp_path / "a.dbc"
    file.write_text('VERSION ""\nBU_: A\nBO_ 1 X: 8 A\n SG_ Temp : 0|8@1+ (1,0) [0|0] "C" A\n')
    with pytest.raises(InputError, match="no signal that looks like steering"):
        proposed(load_database(file)[0], file)
