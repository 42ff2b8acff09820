"""Archives that are damaged or hostile: each is refused in one line, nothing is unpacked, nothing stays."""

import io
import struct
import warnings
import zipfile
import zlib

import fmpy
import pytest

from sidestep.fmu.importing import archive, contents
from sidestep.fmu.importing.archive import describe_fmu, unpack
from sidestep.fmu.scratch import discard
from sidestep.plant_models.errors import InputError
from sidestep.validation.cli.main import main

BINARY = f"binaries/{fmpy.platform}/car{fmpy.sharedLibraryExtension}"
STEER = '<ScalarVariable name="steer" valueReference="0" causality="input"><Real start="0"/></ScalarVariable>'


def description(interface='<CoSimulation modelIdentifier="car"/>', variables=STEER, head='fmiVersion="2.0"', more=""):
    return (
        f'<fmiModelDescription {head} modelName="tiny" guid="1">{interface}{more}<ModelVariables>{variables}'
        "</ModelVariables><ModelStructure/></fmiModelDescription>"
    ).encode()


XML = description()


def zipped(*entries, packing=zipfile.ZIP_DEFLATED):
    """Entries are pairs of name or ZipInfo and data, in order, names twice if they are given twice."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", packing) as target, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of names that are there twice
        for name, data in entries:
            target.writestr(name, data)
    return buffer.getvalue()


def tiny(*more, xml=XML, **options):
    return zipped(("modelDescription.xml", xml), (BINARY, b"no library"), *more, **options)


def fixed(step):
    return tiny(xml=description(more=f'<DefaultExperiment stepSize="{step}"/>'))


def patched(data, old, new, count=-1):
    assert old in data
    return data.replace(old, new, count)


def flagged(bit):
    """The flag of encryption, in every head of the archive."""
    data = bytearray(tiny())
    for mark, at in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        place = data.find(mark)
        while place >= 0:
            data[place + at] |= bit
            place = data.find(mark, place + 4)
    return bytes(data)


def method(number):
    data = bytearray(tiny())
    for mark, at in ((b"PK\x03\x04", 8), (b"PK\x01\x02", 10)):
        place = data.find(mark)
        while place >= 0:
            data[place + at : place + at + 2] = struct.pack("<H", number)
            place = data.find(mark, place + 4)
    return bytes(data)


def told_size(size):
    """The list of contents says another size than there is, of the description."""
    data = bytearray(tiny())
    place = data.find(b"PK\x01\x02")
    data[place + 24 : place + 28] = struct.pack("<I", size)
    return bytes(data)


def spoilt():
    """Bytes in the packed data of a file that nothing would look at before it is unpacked."""
    data = bytearray(tiny(("resources/a", bytes(range(200)) * 20)))
    place = data.find(b"resources/a") + len("resources/a")
    data[place : place + 20] = b"\xff" * 20
    return bytes(data)


def bomb():
    """Packed far better than anything honest: 80 MB of zeros in 80 kB."""
    return tiny(("resources/zeros", b"\0" * (80 << 20)))


def array(count):
    row = f'<Float64 name="a" valueReference="0" causality="input" start="0"><Dimension start="{count}"/></Float64>'
    head = 'fmiVersion="3.0" instantiationToken="1"'
    return tiny(xml=description(variables=row, head=head))


def build(name, include=None):
    """An FMU that brings sources, for another machine, and names a file that is to be compiled."""
    inner = f'<IncludeDirectory name="{include}"/>' if include else ""
    xml = (
        '<fmiBuildDescription fmiVersion="3.0"><BuildConfiguration modelIdentifier="car"><SourceFileSet>'
        f'<SourceFile name="{name}"/>{inner}</SourceFileSet></BuildConfiguration></fmiBuildDescription>'
    )
    head = 'fmiVersion="3.0" instantiationToken="1"'
    row = '<Float64 name="a" valueReference="0" causality="input" start="0"/>'
    return zipped(
        ("modelDescription.xml", description(variables=row, head=head)), ("sources/buildDescription.xml", xml),
    )  # fmt: skip


WHOLE = tiny()
ENTITIES = b'<!DOCTYPE a [<!ENTITY a "aaaaaaaaaa">' + b"".join(
    b'<!ENTITY %c "%s">' % (98 + k, b"&%c;" % (97 + k) * 10) for k in range(12)
)
HOSTILE = {
    "empty file": b"",
    "text": b"hello",
    "no archive but zeros": b"\0" * 1000,
    "another packer's": b"Rar!\x1a\x07\x00" + b"\0" * 100,
    "an empty archive": zipped(),
    "cut in the contents": WHOLE[:-30],
    "cut in the files": WHOLE[: len(WHOLE) // 2],
    "only the end": WHOLE[-22:],
    "no description": zipped((BINARY, b"")),
    "description in a folder": zipped(("tiny/modelDescription.xml", XML)),
    "description elsewhere": zipped(("a/b/modelDescription.xml", XML)),
    "description in capitals": zipped(("MODELDESCRIPTION.XML", XML)),
    "empty description": tiny(xml=b""),
    "no XML": tiny(xml=b"modelName = tiny"),
    "half XML": tiny(xml=XML[:60]),
    "binary XML": tiny(xml=bytes(range(256))),
    "unknown encoding": tiny(xml=b'<?xml version="1.0" encoding="nonsense"?>' + XML),
    "entities in entities": tiny(xml=ENTITIES + b"]>" + XML.replace(b'"tiny"', b'"&m;"')),
    "another's file": tiny(xml=b'<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/hosts">]>' + XML.replace(b"tiny", b"&x;")),
    "XML too deep": tiny(xml=b"<a>" * 100_000 + b"</a>" * 100_000),
    "another root": tiny(xml=b"<a/>"),
    "FMI 1": tiny(xml=description(head='fmiVersion="1.0"')),
    "FMI 9": tiny(xml=description(head='fmiVersion="9.0"')),
    "no version": tiny(xml=description(head="")),
    "model exchange": tiny(xml=description('<ModelExchange modelIdentifier="car"/>')),
    "no interface": tiny(xml=description("")),
    "no identifier": tiny(xml=description("<CoSimulation/>")),
    "identifier that climbs": tiny(xml=description('<CoSimulation modelIdentifier="../../../car"/>')),
    "identifier with a space": tiny(xml=description('<CoSimulation modelIdentifier="car -o x"/>')),
    "reference that is no number": tiny(xml=description(variables=STEER.replace('"0"', '"x"', 1))),
    "step of 1e-300 s": fixed("1e-300"),
    "step of nan": fixed("nan"),
    "negative step": fixed("-0.01"),
    "step of inf": fixed("inf"),
    "step that is a word": fixed("short"),
    "array without end": array(10**9),
    "path that climbs": tiny(("../evil", b"x")),
    "path that climbs further in": tiny(("a/../../evil", b"x")),
    "path from the root": tiny(("/etc/evil", b"x")),
    "path of Windows": tiny(("C:/evil", b"x")),
    "path with backslashes": patched(tiny(("resources/a_b_c", b"x")), b"resources/a_b_c", b"resources\\a_b\\c"),
    "path with a line's end": tiny(("resources/a\nb", b"x")),
    "path of nothing": tiny(("./", b"")),
    "path too deep": tiny(("a/" * 3000 + "b", b"x")),
    "path too long": tiny(("a" * 3000, b"x")),
    "file and folder of one name": tiny(("resources", b"x"), ("resources/a", b"x")),
    "two descriptions": tiny(("modelDescription.xml", b"<a/>")),
    "too many files": zipped(("modelDescription.xml", XML), *((f"resources/{k}", b"") for k in range(20_001))),
    "encrypted": flagged(1),
    "LZMA": method(zipfile.ZIP_LZMA),
    "BZIP2": method(zipfile.ZIP_BZIP2),
    "unknown packing": method(99),
    "a size that is not true": told_size(7),
    "a size of 4 GB": told_size(0xFFFFFFFE),
    "a checksum that is not true": patched(WHOLE, struct.pack("<I", zlib.crc32(XML)), b"\1\2\3\4"),
    "damaged packing": spoilt(),
    "packed too well": bomb(),
    "for another machine": zipped(("modelDescription.xml", XML), ("binaries/win64/car.dll", b"")),
    "sources that climb": build("../../../../etc/passwd"),
    "sources from the root": build("/etc/passwd"),
    "headers that climb": build("a.c", "../../.."),
    "sources of no name": build("."),
}  # fmt: skip


@pytest.fixture
def scratch(tmp_path, monkeypatch):
    """Where FMUs are unpacked."""
    folder = tmp_path / "scratch"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    return folder


@pytest.mark.parametrize("what", HOSTILE)
def test_is_refused_in_a_line_and_leaves_nothing(what, tmp_path, scratch):
    file = tmp_path / "tiny.fmu"
    file.write_bytes(HOSTILE[what])
    with pytest.raises(InputError) as caught:
        unpack(file)
    assert "tiny.fmu" in str(caught.value) or "buildDescription.xml" in str(caught.value)
    assert len(str(caught.value)) < 1500
    assert list(scratch.iterdir()) == []
    assert sorted(path.name for path in tmp_path.iterdir()) == ["scratch", "tiny.fmu"]


def test_there_are_enough_of_them():
    assert len(HOSTILE) >= 40


@pytest.mark.parametrize("packing", [zipfile.ZIP_DEFLATED, zipfile.ZIP_STORED])
def test_the_same_without_damage_is_unpacked(packing, tmp_path, scratch):
    file = tmp_path / "tiny.fmu"
    file.write_bytes(tiny(("resources/a/b.txt", b"x" * 1000), packing=packing))
    fmu = unpack(file)
    assert (fmu.folder / "resources" / "a" / "b.txt").read_bytes() == b"x" * 1000
    assert fmu.about.identifier == "car"
    discard(fmu.folder)
    assert list(scratch.iterdir()) == []


def test_information_unpacks_nothing(tmp_path, scratch, monkeypatch, capsys):
    file = tmp_path / "tiny.fmu"
    file.write_bytes(tiny(("resources/large", b"x" * 5_000_000)))
    monkeypatch.setattr(zipfile.ZipFile, "extractall", None)
    monkeypatch.setattr(archive, "scratch_folder", None)
    assert main(["fmu", "info", str(file)]) == 0
    assert "tiny, FMI 2.0" in capsys.readouterr().out
    assert list(scratch.iterdir()) == []


def test_what_is_large_and_honest_passes(tmp_path, scratch, monkeypatch):
    monkeypatch.setattr(contents, "SMALL", 100_000)
    file = tmp_path / "tiny.fmu"
    noise = bytes((k * k * 31 + k // 7) % 251 for k in range(200_000))
    file.write_bytes(tiny(("resources/noise", noise), packing=zipfile.ZIP_STORED))
    assert describe_fmu(file).name == "tiny"
    monkeypatch.setattr(contents, "MOST_BYTES", 150_000)
    with pytest.raises(InputError, match=r"it unpacks to \d+ bytes; allowed: up to 150000"):
        describe_fmu(file)
