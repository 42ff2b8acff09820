"""Files: complete or not there, devices excepted."""

import os

import pytest

from sidestep.plant_models.errors import InputError
from sidestep.validation.files import check_file, complete, complete_path, made, write_text


def test_a_file_that_breaks_off_leaves_the_one_before(tmp_path):
    file = tmp_path / "a.txt"
    write_text(file, "before")
    with pytest.raises(KeyboardInterrupt), complete(file) as stream:  # noqa: PT012 (the block is what is tested)
        stream.write("half")
        raise KeyboardInterrupt
    assert file.read_text() == "before"
    assert list(tmp_path.iterdir()) == [file]


def test_a_picture_keeps_its_ending_while_it_is_written(tmp_path):
    with complete_path(tmp_path / "a.png") as path:
        assert path.suffix == ".png"
        path.write_bytes(b"drawn")
        assert not (tmp_path / "a.png").exists()
    assert (tmp_path / "a.png").read_bytes() == b"drawn"
    assert len(list(tmp_path.iterdir())) == 1


def test_a_pipe_is_written_to_and_stays_one(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    check_file(pipe, "--junit")
    write_text(pipe, "through it")
    assert os.read(reader, 100) == b"through it"
    os.close(reader)
    assert pipe.is_fifo()
    assert list(tmp_path.iterdir()) == [pipe]


@pytest.mark.parametrize("name", [".", "none/a", "file/a", "x" * 300])
def test_what_cannot_be_written_is_found_before(name, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="--json: cannot write"):
        check_file(tmp_path / name, "--json")
    check_file(tmp_path / "new", "--json")
    check_file(None, "--json")
    assert [file.name for file in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("ending", [KeyboardInterrupt(), InputError("a", "b")])
def test_a_folder_that_stays_empty_goes_again(ending, tmp_path):
    with pytest.raises(type(ending)), made(tmp_path / "a" / "b"):
        raise ending
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(type(ending)), made(tmp_path / "a" / "b"):  # noqa: PT012
        write_text(tmp_path / "a" / "b" / "row", "done")
        raise ending
    assert (tmp_path / "a" / "b" / "row").exists()
    with pytest.raises(InputError, match="--out: cannot write to"), made(tmp_path / ("x" * 300)):
        pass
