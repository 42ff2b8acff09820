"""JUnit XML, as build servers read it: one test case for each run or check."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from sidestep.validation.files import write_text, written_file
from sidestep.validation.judge.findings import Verdict


class JunitCase(NamedTuple):
    """One case: where it belongs, its name, and why it failed or broke off; both are empty if it passed."""

    group: str
    name: str
    failure: str = ""
    error: str = ""


def judged_case(group: str, name: str, verdict: Verdict, text: str) -> JunitCase:
    """A judged drive: one that shows nothing is an error, which no build server takes for a success."""
    if verdict is Verdict.INCONCLUSIVE:
        return JunitCase(group, name, error=f"inconclusive: {text}")
    return JunitCase(group, name, "" if verdict is Verdict.PASS else text)


def write_junit(file: Path, suite: str, cases: Sequence[JunitCase]) -> None:
    """Write a test suite; complete or not there.

    Raises:
        InputError: The file cannot be written.
    """
    failures, errors = sum(bool(case.failure) for case in cases), sum(bool(case.error) for case in cases)
    counts = {"tests": str(len(cases)), "failures": str(failures), "errors": str(errors)}
    top = ElementTree.Element("testsuites", counts)
    below = ElementTree.SubElement(top, "testsuite", {"name": suite, **counts})
    for case in cases:
        element = ElementTree.SubElement(below, "testcase", {"classname": case.group, "name": case.name})
        for kind in ("failure", "error"):
            if text := _printable(getattr(case, kind)):
                ElementTree.SubElement(element, kind, {"message": text})
    ElementTree.indent(top)
    with written_file(file, "--junit"):
        write_text(file, ElementTree.tostring(top, encoding="unicode", xml_declaration=True) + "\n")


def _printable(text: str) -> str:
    """Without the control characters that XML has no place for."""
    return "".join(letter for letter in text if letter >= " " or letter in "\t\n")
