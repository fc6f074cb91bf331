"""A study's page and figure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from sprl_bench import plots
from sprl_bench.records import write_bytes
from sprl_bench.studies.study import Evidence, Study
from sprl_bench.studies.verdicts import Verdict
from sprl_bench.tables import render, split_suites, tabulate_results

INTERVALS: Final = (
    "Bootstrap intervals; over few seeds they are somewhat too narrow. The seeds of two agents are resampled "
    "independently, so agents with the same runs have a difference of 0 with an interval around it."
)
STEMS: Final = (".md", ".png", ".pdf")


def write_study(
    study: Study,
    evidence: Evidence,
    verdict: Verdict,
    folder: Path,
    *,
    command: str,
    missing: Sequence[str] = (),
    short: Sequence[str] = (),
) -> list[Path]:
    """Write the page and the figure, as PNG and PDF, and return their paths.

    Args:
        study: The study.
        evidence: Its finished runs.
        verdict: What they say.
        folder: Where to write.
        command: That repeats it.
        missing: The names of runs that are not finished.
        short: Sentences on runs that are too short to answer.

    Raises:
        ModuleNotFoundError: matplotlib, of the extra `plots`, is not installed.
    """
    page, *pictures = (folder / f"{study.name}{suffix}" for suffix in STEMS)
    drawn = [picture for picture in pictures if _draw(study, evidence, picture)]
    write_bytes(page, _page(study, evidence, verdict, command, missing, short, bool(drawn)).encode())
    return [page, *drawn]


def _draw(study: Study, evidence: Evidence, picture: Path) -> bool:
    """Draw the figure, and return whether there was anything to draw."""
    if study.draw is not None:
        return study.draw(evidence, picture)
    if not evidence.results:
        return False
    if study.figure == "metric":
        if not any(study.metric in line for _, lines in evidence.logged for line in lines):
            return False
        plots.plot_metrics(evidence.logged, picture, [study.metric])
    elif study.figure == "axis" and _has_axis(study, evidence):
        plots.plot_axis(evidence.results, picture, study.axis, study.axis_default)
    else:
        plots.plot_results(evidence.results, picture, allow_missing=True)
    return True


def _has_axis(study: Study, evidence: Evidence) -> bool:
    return len({one.task.arguments.get(study.axis, study.axis_default) for one in evidence.results}) > 1


def _page(
    study: Study,
    evidence: Evidence,
    verdict: Verdict,
    command: str,
    missing: Sequence[str],
    short: Sequence[str],
    has_figure: bool,
) -> str:
    lines = [
        f"# {study.name}: {study.title}",
        "",
        f"**The paper's claim.** {study.claim}",
        "",
        f"**Verdict.** {verdict.short}",
        "",
    ]
    if verdict.differences:
        lines += [*_differences(verdict), "", INTERVALS, ""]
    if study.decisions:
        lines += [study.decisions, ""]
    if has_figure:
        lines += [f"![{study.title}]({study.name}.png)", ""]
    if study.table is not None and (numbers := study.table(evidence)):
        lines += [numbers, ""]
    if evidence.results:
        lines += [*_runs(evidence), *_unnamed(study, evidence), "", _tables(evidence), ""]
    if short:
        lines += [*(f"**Too short.** {sentence}" for sentence in short), ""]
    if missing:
        lines += [f"**Missing.** {len(missing)} runs: {'; '.join(missing[:5])}{' ...' * (len(missing) > 5)}.", ""]
    return "\n".join([*lines, "```", command, "```", ""])


def _differences(verdict: Verdict) -> list[str]:
    """Return the table of the differences that a verdict rests on."""
    rows = [(one.what, f"{one.value:+.3f}", one.ends, one.outcome) for one in verdict.differences]
    head = ("difference", "value", "95 % interval", "that it is above 0")
    return [f"| {' | '.join(row)} |" for row in (head, ("---",) * len(head), *rows)]


def _unnamed(study: Study, evidence: Evidence) -> list[str]:
    """Return a sentence on the axis' value of the agents whose names do not give it."""
    values = {
        one.hyperparameters[study.axis]
        for one in evidence.results
        if study.axis in one.hyperparameters and f"+{study.axis}=" not in one.agent
    }
    return [f"An agent without {study.axis} in its name has {study.axis} = {values.pop()}."] if len(values) == 1 else []


def _runs(evidence: Evidence) -> list[str]:
    tasks = {one.task.name: one.task.budget for one in evidence.results}
    seeds = sorted({one.seed for one in evidence.results})
    steps = ", ".join(f"{task} ({budget:,} env steps)" for task, budget in tasks.items())
    return [f"**Runs.** {steps}; seeds {', '.join(map(str, seeds))}."]


def _tables(evidence: Evidence) -> str:
    """Return the tables of the runs, one a suite."""
    tables = [tabulate_results(group, allow_missing=True) for group in split_suites(evidence.results)]
    return render(tables, "md").rstrip("\n")
