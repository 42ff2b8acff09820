"""Running a campaign: every case a pure function of the specification, on all cores or on a Dask cluster."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import asdict
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import cast

import msgspec
import numpy as np
from joblib import Parallel, delayed, parallel_config

from sidestep.plant_models.errors import InputError
from sidestep.validation.campaigns.campaign import Campaign, Case, cases, scenario_of
from sidestep.validation.campaigns.journal import Row, open_journal, read_journal
from sidestep.validation.campaigns.rows import check_rows
from sidestep.validation.console import progress_bar
from sidestep.validation.judge.simulate import simulate
from sidestep.validation.judge.summary import versions
from sidestep.validation.judge.verdict import Judgement
from sidestep.validation.loop.recording import Recording
from sidestep.validation.scenarios.scenario import Scenario

ERROR = "error"
"""Label of a case that could not be run; its row says why."""

_AHEAD = "2 * n_jobs"
_SUSPECTS = 4
"""Cases for each process that are handed out before they are begun, and that may have been at work when one died."""

Work = Callable[[Case], Row]


def run_case(campaign: Campaign, case: Case) -> Row:
    """Drive and judge one case: flat, JSON, and the same wherever it is run; what is raised becomes a row, too."""
    try:
        scenario = scenario_of(campaign, case)
        return {**asdict(case), **figures(scenario, *simulate(scenario))}
    except Exception as error:
        return failure(case, f"{type(error).__name__}: {error}")


def figures(scenario: Scenario, recording: Recording, judgement: Judgement) -> Row:
    """What a row keeps of a run; `margin_m` is the smaller one of the clearances to obstacles and edges."""
    gap, edge = judgement.min_clearance, judgement.min_edge_clearance
    row = {
        "verdict": judgement.verdict.value,
        "label": judgement.label,
        "end": recording.end.value,
        "margin_m": edge if gap is None else min(gap, edge),
        "min_clearance_m": gap,
        "min_edge_clearance_m": edge,
        "max_lateral_acceleration": _peak(recording["lateral_acceleration"]),
        "max_steer_rate": _peak(recording["steer_rate"]),
        "rms_lateral_error_m": float(np.sqrt(np.mean((recording["l"] - scenario.controller.reference_offset) ** 2))),
        "final_speed": float(recording["v_x"][-1]),
        "infeasible_steps": recording.infeasible_steps,
        "error": f"{type(recording.error).__name__}: {recording.error}" if recording.error else None,
    }
    return {key: None if isinstance(value, float) and not np.isfinite(value) else value for key, value in row.items()}


def failure(case: Case, error: str) -> Row:
    """The row of a case that could not be run."""
    return {**asdict(case), "verdict": "fail", "label": ERROR, "end": ERROR, "margin_m": None, "error": error}


def _peak(values: np.ndarray) -> float:
    return float(np.abs(values).max())


def run_campaign(
    campaign: Campaign, file: Path, jobs: int = -1, dask: str | None = None, work: Work | None = None
) -> list[Row]:
    """Run what is not in the journal yet, and write each row there as it is done.

    Args:
        campaign: What to run.
        file: The journal; one that is there is gone on with.
        jobs: Processes, -1 for one per core.
        dask: Address of a cluster's scheduler that runs them instead.
        work: What runs a case; `run_case` if None.

    Returns:
        All rows of the campaign, in their order.

    Raises:
        InputError: The journal or the cluster cannot be used, or a row that is there is none of this campaign's.
    """
    every = cases(campaign)
    with _workers(jobs, dask) as run, open_journal(file, _head(campaign)) as journal:
        check_rows(every, journal.rows, file)
        done = {row["row"] for row in journal.rows}
        left = [case for case in every if case.row not in done]
        with progress_bar(campaign.name, len(every), counting=True) as progress:
            progress(len(journal.rows))
            for row in run(work or partial(run_case, campaign), left):
                journal.append(row)
                progress(len(journal.rows))
        return sorted(journal.rows, key=lambda row: row["row"])


def load_rows(file: Path) -> tuple[Campaign, list[Row]]:
    """The specification and the rows of a journal.

    Raises:
        InputError: It is none, not a campaign's, or holds rows that its campaign does not have.
    """
    head, rows = read_journal(file)
    try:
        campaign = msgspec.convert({**head["campaign"], "file": head["about"]["file"]}, Campaign)
    except (KeyError, TypeError, msgspec.ValidationError) as error:
        raise InputError(str(file), "was not written by a campaign", "a campaign's .jsonl file") from error
    check_rows(cases(campaign), rows, file)
    return campaign, rows


def about(campaign: Campaign) -> dict[str, str]:
    """What was run, for the record."""
    return {"Scenario": campaign.scenario, "Versions": ", ".join(f"{n} {v}" for n, v in versions().items())}


def _head(campaign: Campaign) -> Row:
    specification = msgspec.to_builtins(campaign)
    return {"campaign": {**specification, "file": ""}, "about": {"file": campaign.file, "versions": versions()}}


@contextmanager
def _workers(jobs: int, dask: str | None) -> Iterator[Callable[[Work, Sequence[Case]], Iterable[Row]]]:
    """What runs cases, in any order: processes here, or through the same joblib call the workers of a cluster."""
    if dask is None:
        yield partial(_in_parallel, jobs, BrokenProcessPool)
        return
    try:
        from distributed import Client, KilledWorker
    except ImportError as error:
        raise InputError("--dask", "needs the package distributed", "pip install 'sidestep[dask]'") from error
    try:
        client = Client(dask, timeout=10)
    except (OSError, ValueError) as error:
        raise InputError(
            "--dask", f"no scheduler answers at {dask!r}", "tcp://HOST:PORT of `dask scheduler`"
        ) from error
    with client, parallel_config(backend="dask"):
        try:
            client.wait_for_workers(1, timeout=30)
        except TimeoutError as error:
            raise InputError("--dask", f"{dask} has no workers", f"start some: dask worker {dask}") from error
        yield partial(_in_parallel, -1, KilledWorker)


def _in_parallel(jobs: int, death: type[BaseException], work: Work, cases: Sequence[Case]) -> Iterator[Row]:
    """Rows as they are done; when a process dies, those that may have been at work are run one at a time."""
    left = {case.row: case for case in cases}
    while left:
        parallel = Parallel(n_jobs=jobs, return_as="generator_unordered", pre_dispatch=_AHEAD)
        try:
            for row in cast("Iterable[Row]", parallel(delayed(work)(case) for case in list(left.values()))):
                del left[row["row"]]
                yield row
        except death:
            suspects = list(left.values())[: _SUSPECTS * parallel.n_jobs]
            for row in _one_at_a_time(work, suspects):
                del left[row["row"]]
                yield row


def _one_at_a_time(work: Work, cases: Sequence[Case]) -> Iterator[Row]:
    waiting = list(cases)
    while waiting:
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            try:
                while waiting:
                    row = pool.submit(work, waiting[0]).result()
                    del waiting[0]
                    yield row
            except BrokenProcessPool:
                yield failure(waiting.pop(0), "the process that ran it died")
