"""Write the page of what reproduces: `python docs/write_reproduction.py docs/reproduction.md`.

The verdicts on leaderboards follow from their entries, and those on what is counted from counting it again.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from sprl_bench import leaderboard
from sprl_bench.scores import Array
from sprl_bench.studies import STUDIES, Verdict, evidence_of_entries, specs_of
from sprl_bench.studies.verdicts import Difference, all_above, difference
from sprl_bench.tables import Result, task_names

BOARD: Final = "grid-7x7"
SEEDS: Final = range(5)
HEAD: Final = f"""# What reproduces and what does not

Every claim of the paper's appendices A, B and C that can be tested here, and what this benchmark has measured of it. A
claim about agents is a difference: **supported** if its 95 % interval lies above 0, **contradicted** if it lies below,
else **not decided** ([how](experiments.md)), from at least five seeds. Claims about counting and theory are checked
exactly, on the worlds that are named. **Open**: the runs have not been made; the command makes and judges them.

Where the evidence is "board", the runs are the entries of `{BOARD}`: five seeds, both 7x7 grids
([all numbers and how far to trust them](results.md)).

`python docs/write_reproduction.py docs/reproduction.md` computes this page from the entries.

| claim | evidence | verdict | command |
| --- | --- | --- | --- |
"""
TAIL: Final = """
**Not measured here**: Figures 9, 11, 13 and 18 need three levels of DeepMind Lab and 20 million steps a run. The
first-person mazes stand for them ([mazes.md](mazes.md)), and the suite `maze` has those budgets. Figure 19 needs the
six Atari games ([atari.md](atari.md)). We had the paper's abstract and appendices, but not the rest of its text: claims
that are made only there are missing.
"""
SHOW: Final = f"`sprl-bench leaderboard show {BOARD}`"


@dataclass(frozen=True)
class Row:
    """One claim.

    Attributes:
        claim: In our words.
        evidence: What was measured, with seeds and intervals.
        verdict: Supported, contradicted, not decided or open.
        command: That measures or judges it.
    """

    claim: str
    evidence: str
    verdict: str
    command: str

    def __str__(self) -> str:
        """Return the row, Markdown."""
        return f"| {self.claim} | {self.evidence} | {self.verdict} | {self.command} |"


def page() -> str:
    """Return the whole page."""
    return HEAD + "\n".join(map(str, rows())) + "\n" + TAIL


def rows() -> Iterator[Row]:
    """Yield the claims: of the whole paper, of its figures in their order, and of its theory."""
    results = [result for entry in leaderboard.find_board(BOARD) for result in entry.results()]
    for preset, words in (("@tuned", "with the preset `tuned`"), ("", "with the settings of Table 1")):
        for other in ("ppo", "icm", f"eco{preset}"):
            claim = f"SPRL scores more than `{other}` on the 7x7 grids, {words} (abstract, in part)"
            yield _beats(results, f"sprl{preset}", other, claim)
    for name in STUDIES:
        yield FINDINGS[name](name) if name in FINDINGS else _open(name)
    yield from THEORY


def _beats(results: Sequence[Result], agent: str, other: str, claim: str) -> Row:
    plus, minus = _aucs(results, agent), _aucs(results, other)
    verdict = all_above([difference("mean AUC", plus, minus)])
    return Row(claim, f"board: {_numbers(verdict)}", verdict.outcome, SHOW)


def _aucs(results: Sequence[Result], agent: str) -> list[Array]:
    """Return an agent's scores on each task."""
    mine = [one for one in results if one.agent == agent and one.seed in SEEDS]
    return [np.array([one.scores.auc for one in mine if one.task.name == task]) for task in task_names(mine)]


def _numbers(verdict: Verdict) -> str:
    return verdict.fact or "; ".join(map(_ends, verdict.differences))


def _ends(found: Difference) -> str:
    ends = f" [{found.interval.low:.2f}, {found.interval.high:.2f}]" if found.interval else ""
    return f"{found.what} {found.value:+.2f}{ends}"


def _claim(name: str) -> str:
    return f"{STUDIES[name].title} {STUDIES[name].claim}"


def _open(name: str, evidence: str = "none yet") -> Row:
    return Row(_claim(name), evidence, "open", f"`sprl-bench reproduce {name}`")


def _counted(name: str) -> Row:
    study = STUDIES[name]
    verdict = study.judge(evidence_of_entries([], []), study.agents)
    return Row(_claim(name), _numbers(verdict), verdict.outcome, f"`sprl-bench reproduce {name}`")


def _on_board(name: str) -> Row:
    study = STUDIES[name]
    results = [result for entry in leaderboard.find_board(BOARD) for result in entry.results()]
    verdict = study.judge(evidence_of_entries(specs_of(study, SEEDS), results), study.agents)
    command = f"`sprl-bench reproduce {name} --board {BOARD}`"
    return Row(_claim(name), f"board: {_numbers(verdict)}", verdict.outcome, command)


FINDINGS: Final = {
    "fig17": partial(
        _open,
        evidence="With the preset `tuned` at 400,000 steps: .842 (.836 to .846) on KeyDoors-7x7, .819 (.772 to .867) "
        "on FourRooms-7x7, five seeds ([accuracy.md](../notes/accuracy.md)). The claim is judged on all four grids by "
        "Table 1's settings.",
    ),
    "fig20": partial(
        _open,
        evidence="three seeds of Reach at substep 3 ([fetch-frame.md](../notes/fetch-frame.md))",
    ),
    "fig21": _on_board,
    "sec6.6": _counted,
}
TESTS: Final = "`python -m pytest tests/theory`"
THEORY: Final = (
    Row(
        "Theorem 1: an optimal policy satisfies the constraint, in deterministic worlds and with chance inside rooms "
        "of one rewarded exit",
        "300 random worlds of each kind, solved exactly ([optimality.md](optimality.md))",
        "supported",
        TESTS,
    ),
    Row(
        "Lemma 4: in such rooms, a policy with a lower value than the best breaks the constraint",
        "300 random worlds with rooms",
        "supported",
        TESTS,
    ),
)

if __name__ == "__main__":
    Path(sys.argv[1]).write_text(page(), encoding="utf-8")
