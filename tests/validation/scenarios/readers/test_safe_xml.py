import pytest

from sidestep.plant_models import documents
from sidestep.plant_models.errors import InputError
from sidestep.validation.scenarios.readers.openscenario.expressions import resolved
from sidestep.validation.scenarios.readers.safe_xml import number, read_xml

BOMB = """<?xml version="1.0"?>
<!DOCTYPE a [<!ENTITY b "bbbbbbbbbb"><!ENTITY c "&b;&b;&b;&b;&b;&b;">]>
<commonRoad>&c;</commonRoad>"""


def test_a_plain_file_is_read(tmp_path):
    (tmp_path / "a.xml").write_text('<a b="1"><c>text</c></a>', encoding="utf-8-sig")
    root = read_xml(tmp_path / "a.xml")
    assert (root.tag, root.get("b"), root.findtext("c")) == ("a", "1", "text")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (BOMB, "declares a document type"),
        ('<!DOCTYPE a SYSTEM "file:///etc/passwd"><a/>', "declares a document type"),
        ("<a><b></a>", "is no XML"),
        ("", "is no XML"),
        ("\x00\x01", "is no XML"),
        ('<?xml version="1.0" encoding="nonsense"?><a/>', "is no XML"),
        ("<a>" * 200 + "</a>" * 200, "is too deep"),
    ],
)
def test_what_is_dangerous_or_broken_is_refused(tmp_path, text, problem):
    (tmp_path / "a.xml").write_text(text)
    with pytest.raises(InputError, match=problem) as caught:
        read_xml(tmp_path / "a.xml")
    assert "\n" not in str(caught.value)


def test_what_is_too_large_is_not_even_opened(tmp_path, monkeypatch):
    monkeypatch.setattr(documents, "MAX_BYTES", 10)
    (tmp_path / "a.xml").write_text("<aaaaaaaaaaaaa/>")
    with pytest.raises(InputError, match="up to 10 bytes"):
        read_xml(tmp_path / "a.xml")
    with pytest.raises(InputError, match="cannot be read"):
        read_xml(tmp_path / "none.xml")


@pytest.mark.parametrize("text", ["nan", "inf", "1e99", "", "x", None])
def test_numbers_are_finite(text):
    with pytest.raises(InputError):
        number(text, "here")


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("plain", "plain"),
        ("$a", "2.0"),
        ("./$name/b.xodr", "./road/b.xodr"),
        ("${3 * $a - 1}", "5.0"),
        ("${-$a}", "-2.0"),
        ("${sqrt($a * 8) + pow(2, 3)}", "12.0"),
        ("${-10.0 * ($neg / 4)}", "10.0"),
    ],
)
def test_parameters_and_expressions(text, value):
    assert resolved(text, {"a": "2.0", "neg": "-4.0", "name": "road"}, "here") == value


@pytest.mark.parametrize(
    "text", ["$b", "${1/0}", "${__import__('os')}", "${(1).real}", "${a}", "${1 +}", "${sqrt(-1)}"]
)
def test_expressions_are_only_arithmetic(text):
    with pytest.raises(InputError):
        resolved(text, {"a": "1"}, "here")
