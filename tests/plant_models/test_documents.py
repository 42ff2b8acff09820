"""The readers of TOML and JSON: what nothing can take is refused in one line, with its key."""

import pytest

from sidestep.plant_models import documents
from sidestep.plant_models.documents import json_value, read_json, read_toml, toml_tables, toml_value
from sidestep.plant_models.errors import InputError, PlantError, printable
from sidestep.plant_models.fresh_file import beside


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("a = " + "[" * 3000, "nested more than 64 deep"),
        ("a = " + "[" * 70 + "]" * 70, "nested more than 64 deep"),
        ("a = " + "9" * 5000, "no readable TOML file"),
        ("a = 0x" + "f" * 5000, "a: 0xffffffffffffffffff...: a whole number of more than 64 bits"),
        ("a = -1" + "0" * 308, r"a: -1000000000000000000\.\.\.: a whole number of more than 64 bits"),
        ("[b]\na = [1, 9223372036854775808]", r"b\.a\[1\]: 9223372036854775808: a whole number of more than 64 bits"),
        ("[set]\nspeed = 1979-05-27", r"file: set\.speed: a date, 1979-05-27, where a number or text is needed"),
        ("a = 07:32:00", "a: a time, 07:32:00"),
        ("a =", "no readable TOML file"),
    ],
)
def test_what_no_reader_behind_could_take(text, problem):
    with pytest.raises(InputError, match=problem) as caught:
        toml_tables(text, "file")
    assert len(str(caught.value)) < 400


def test_json_is_held_to_the_same():
    with pytest.raises(InputError, match="nested more than 64 deep"):
        json_value("[" * 5000, "file")
    with pytest.raises(InputError, match="is no JSON"):
        json_value("9" * 5000, "file")
    with pytest.raises(InputError, match="a: text that is no Unicode"):
        json_value('{"a": "\\ud800"}', "file")
    assert json_value('{"a": [1, 2.5, null, true, "x"]}', "file") == {"a": [1, 2.5, None, True, "x"]}


def test_words_of_set_are_values_or_text():
    assert [toml_value(text, "--set") for text in ("3", "[1.0]", "wet road")] == [3, [1.0], "wet road"]
    for text in ("9" * 5000, "[" * 3000, "1979-05-27"):
        with pytest.raises(InputError, match="--set"):
            toml_value(text, "--set")


def test_files_that_are_none(tmp_path, monkeypatch):
    (tmp_path / "bytes").write_bytes(b"\xff\xfe\x00")
    for file in (tmp_path / "none", tmp_path, tmp_path / "bytes", tmp_path / "a\0b"):
        for read in (read_toml, read_json):
            with pytest.raises(InputError, match=r"cannot be read|is no JSON"):
                read(file)
    monkeypatch.setattr(documents, "MAX_BYTES", 1000)
    with pytest.raises(InputError, match="up to 1000 bytes"):
        read_toml("/dev/zero")


def test_errors_show_what_a_terminal_would_obey():
    assert str(InputError("\x1b[2Jkey", "\u202egnp")) == "\\x1b[2Jkey: \\u202egnp"
    assert str(PlantError("said \x9b31m")) == "said \\x9b31m"
    assert printable("ä µ – 1\n2\t3") == "ä µ – 1\n2\t3"


def test_a_fresh_file_is_exclusive_and_of_no_name_to_wait_under(tmp_path):
    names = {beside(tmp_path / "a.png") for _ in range(20)}
    assert len(names) == 20
    assert {file.suffix for file in names} == {".png"}
