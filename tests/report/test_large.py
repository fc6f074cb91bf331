"""The report of a suite as large as a report must bear: 20 agents on 20 tasks, ten seeds each, 8 metrics."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from itertools import product

import numpy as np

from sprl_bench.records import RunRecord
from sprl_bench.report import Progress, Source, of_runs, render_report
from sprl_bench.report.source import Logged

MakeRecord = Callable[..., RunRecord]
AGENTS, TASKS, SEEDS, METRICS = 20, 20, 10, 8
LOGGED = 500  # runs whose diagnostics the command reads, at most
MOST_BYTES = 6_000_000


def test_a_large_report_is_below_6_mb_and_leaves_no_run_out(make_record: MakeRecord) -> None:
    page = render_report(large_source(make_record))
    [data] = re.findall(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    [section] = json.loads(data)["sections"]
    assert sum(len(curve["runs"]) for curve in section["curves"]) == AGENTS * TASKS * SEEDS
    assert len(page.encode()) < MOST_BYTES


def large_source(make_record: MakeRecord) -> Source:
    """Return the source of such a report; no curve is smooth, so that its numbers are as long as numbers get."""
    generator = np.random.default_rng(0)
    runs = list(_runs(make_record, generator))
    progress = [Progress(run.spec, "finished", run.spec.task.budget) for run in runs]
    by_seed = sorted(runs, key=lambda run: run.spec.seed)
    return of_runs("large", runs, progress, logged=[_logged(run, generator) for run in by_seed[:LOGGED]])


def _runs(make_record: MakeRecord, generator: np.random.Generator) -> Iterator[RunRecord]:
    rise = np.linspace(0, 1, 100) ** 0.5
    for agent, task, seed in product(range(AGENTS), range(TASKS), range(SEEDS)):
        curve = rise * (0.1 + 0.8 * agent / AGENTS) + 0.1 * generator.random(100)
        run = make_record(f"agent-{agent:02}", seed=seed, curve=curve, task_changes={"name": f"Task-{task:02}"})
        yield run.model_copy(update={"spec": run.spec.model_copy(update={"suite": "large"})})


def _logged(run: RunRecord, generator: np.random.Generator) -> Logged:
    """Return what a run logged: a line for each bin of its curve."""
    steps = np.linspace(0, run.spec.task.budget, 101)[1:]
    values = generator.random((100, METRICS))
    lines = [
        {"env_steps": int(step), "wall_time_s": 1.0, **{f"metric-{n}": value for n, value in enumerate(row)}}
        for step, row in zip(steps, values.tolist(), strict=True)
    ]
    return run.spec, lines
