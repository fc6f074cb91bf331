"""Studies: the experiments of the paper's appendix, each as one value that can be run, drawn and judged."""

from __future__ import annotations

from sprl_bench.studies.page import STEMS, write_study
from sprl_bench.studies.rows import STUDIES, find_study
from sprl_bench.studies.study import Evidence, Study, evidence_of, evidence_of_entries, missing_runs, specs_of
from sprl_bench.studies.verdicts import Outcome, Verdict

__all__ = [
    "STEMS",
    "STUDIES",
    "Evidence",
    "Outcome",
    "Study",
    "Verdict",
    "evidence_of",
    "evidence_of_entries",
    "find_study",
    "missing_runs",
    "specs_of",
    "write_study",
]
