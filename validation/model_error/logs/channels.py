"""Channels of a log file, whatever it is: tables (.csv, .parquet), MF4, or CAN frames with a database; .gz of any."""

import csv
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.unpacking import unpack_gz
from sidestep.validation.model_error.logs.channel import Channel
from sidestep.validation.model_error.logs.frames import read_frames
from sidestep.validation.model_error.logs.mapping import LogMap
from sidestep.validation.model_error.logs.units import factor, split_unit

Array = NDArray[np.float64]

KINDS = ".csv, .txt, .tsv, .parquet, .mf4, .mdf; with `dbc` in the mapping .blf, .asc, .log, .csv; each with .gz"
_LONGEST_HEAD = 1 << 16  # letters
_TIMES = ("time", "t", "timestamp", "timestamps", "seconds", "sec")


def read_channels(path: Path, mapping: LogMap) -> tuple[dict[str, Channel], list[str]]:
    """All numeric channels of a log by name, and what there was to say about the file.

    Raises:
        InputError: The file cannot be read, is of an unknown kind, or a library for it is not installed.
    """
    with _unpacked(path) as (file, ending):
        if mapping.dbc is not None:
            return read_frames(file, path, mapping.dbc)
        notes: list[str] = []
        table = partial(_csv, notes)
        readers: dict[str, Callable[[Path, Path, LogMap], dict[str, Channel]]] = {
            ".csv": table, ".txt": table, ".tsv": table, ".parquet": _parquet, ".mf4": _mdf, ".mdf": _mdf,
        }  # fmt: skip
        if ending in (".blf", ".asc", ".log"):
            raise InputError("dbc", f"missing in the mapping: {path.name} holds CAN frames", "the path of a database")
        if ending not in readers:
            raise InputError(str(path), f"unknown kind of log {ending!r}", KINDS)
        return readers[ending](file, path, mapping), notes


@contextmanager
def _unpacked(path: Path) -> Iterator[tuple[Path, str]]:
    """The file without .gz, and its ending."""
    if not path.is_file():
        raise InputError("--log", f"no file {str(path)!r}", KINDS)
    if path.suffix.lower() != ".gz":
        yield path, path.suffix.lower()
        return
    inner = Path(path.stem)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / inner.name
        unpack_gz(path, file)
        yield file, inner.suffix.lower()


def _csv(notes: list[str], file: Path, shown: Path, mapping: LogMap) -> dict[str, Channel]:
    try:
        with file.open(encoding="utf-8-sig", newline="") as stream:
            first = stream.readline(_LONGEST_HEAD)
            try:
                delimiter = csv.Sniffer().sniff(first, ",;\t").delimiter
            except csv.Error as error:
                raise InputError(str(shown), f"no columns in {first[:60]!r}", "a head line and columns") from error
            heads = next(csv.reader([first], delimiter=delimiter))
            lines: Iterator[str] = (
                (line.replace(",", ".") for line in stream) if delimiter == ";" else iter(stream)
            )  # decimal commas
            with warnings.catch_warnings(record=True) as said:
                warnings.simplefilter("always")
                table = np.genfromtxt(lines, delimiter=delimiter, dtype=np.float64, invalid_raise=False, ndmin=2)
            if said:
                notes.append(f"lines that have not {table.shape[1]} columns are left out")
    except (OSError, UnicodeDecodeError, ValueError) as error:
        raise InputError(str(shown), f"cannot be read as a table ({error})", KINDS) from error
    if table.shape[1] != len(heads) or len(table) < 2:
        raise InputError(str(shown), f"{len(heads)} heads, {table.shape[1]} columns, {len(table)} rows", "a table")
    return _with_time(dict(zip(heads, table.T, strict=True)), shown, mapping)


def _parquet(file: Path, shown: Path, mapping: LogMap) -> dict[str, Channel]:
    try:
        from pyarrow import parquet
    except ImportError as error:
        raise InputError(str(shown), "needs the package pyarrow", "pip install 'sidestep[parquet]'") from error
    try:
        table = parquet.read_table(file)
    except (OSError, ValueError) as error:
        raise InputError(str(shown), f"cannot be read ({error})", KINDS) from error
    columns = {}
    for name in table.column_names:
        values = table.column(name).to_numpy()
        if np.issubdtype(values.dtype, np.datetime64):
            values = values.astype("datetime64[ns]").astype(np.int64) * 1e-9
        if np.issubdtype(values.dtype, np.number):
            columns[name] = values.astype(np.float64)
    return _with_time(columns, shown, mapping)


def _with_time(columns: dict[str, Array], shown: Path, mapping: LogMap) -> dict[str, Channel]:
    names = {split_unit(head)[0].lower(): head for head in columns}
    head = next((h for h in columns if mapping.time and mapping.time in (h, split_unit(h)[0])), None)
    if head is None and not mapping.time:
        head = next((names[name] for name in _TIMES if name in names), None)
    if head is None:
        raise InputError(f"{shown}: time", f"no column {mapping.time or 'of time'!r}", ", ".join(columns))
    time = columns[head] * factor("time", mapping.time_unit or split_unit(head)[1], f"{shown}: {head}")
    return {name: Channel(time, values, split_unit(name)[1]) for name, values in columns.items() if name != head}


def _mdf(file: Path, shown: Path, mapping: LogMap) -> dict[str, Channel]:
    try:
        import asammdf
    except ImportError as error:
        raise InputError(str(shown), "needs the package asammdf", "pip install 'sidestep[mdf]'") from error
    channels = {}
    try:
        with asammdf.MDF(file) as mdf:
            for signal in mdf.iter_channels(skip_master=True):
                if np.issubdtype(signal.samples.dtype, np.number) and signal.samples.ndim == 1:
                    values = signal.samples.astype(np.float64)
                    channels[signal.name] = Channel(np.asarray(signal.timestamps), values, signal.unit or "")
    except Exception as error:  # asammdf lets every kind of error out
        raise InputError(str(shown), f"cannot be read ({error})", KINDS) from error
    return channels
