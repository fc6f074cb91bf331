"""Write the published bands of learning curves, `sprl_bench/known_answers/bands.json`, from folders of runs.

The runs: `sprl-bench run --suite smoke --agents NAME --seeds 200,201,...,209` and the probes of the suite `check`, as
`sprl_bench.known_answers.check_agent(NAME, out=...)` trains them, with the same seeds. Only agents with all ten seeds
of a task are published there; what is published of agents without runs in these folders stays.

    python notes/make_bands.py FOLDER...
"""

from __future__ import annotations

import json
import re
import sys
from collections import defaultdict

from sprl_bench.known_answers.bands import FILE, figures_of, published
from sprl_bench.known_answers.check import BAND_SEEDS, SUITE
from sprl_bench.known_answers.probe_envs import KNOWN
from sprl_bench.records import RunRecord, find_records

DIGITS = 4


def main(folders: list[str]) -> None:
    """Write the bands of the runs in these folders."""
    records = [one for folder in folders for one in find_records(folder) if one.status == "complete"]
    figures: dict[str, dict[str, list[list[float]]]] = published()["figures"]
    for task in SUITE.tasks:
        runs: dict[str, dict[int, RunRecord]] = defaultdict(dict)
        for one in records:
            if one.spec.task.name == task.name and one.spec.task.budget == task.budget:
                runs[one.spec.agent][one.spec.seed] = one
        if task.env_id in KNOWN and KNOWN[task.env_id][0] == 1:  # whatever an agent does
            continue
        new = {
            agent: [figures_of(of_agent[seed].return_curve).round(DIGITS).tolist() for seed in BAND_SEEDS]
            for agent, of_agent in runs.items()
            if set(BAND_SEEDS) <= set(of_agent)
        }
        figures[task.name] = dict(sorted({**figures[task.name], **new}.items()))
    used = [one for one in records if one.spec.seed in BAND_SEEDS]
    made = {
        "seeds": list(BAND_SEEDS),
        "machine": sorted({one.hardware.cpu for one in used}),
        "versions": {
            name: sorted({one.versions[name] for one in used if name in one.versions})
            for name in ("gymnasium", "numpy", "python", "sprl-bench", "torch")
        },
    }
    text = json.dumps({"made": made, "figures": figures}, indent=1)
    one_line_a_run = re.sub(r"\[[\d.,\s]+\]", lambda found: " ".join(found[0].split()), text)
    FILE.write_text(one_line_a_run + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
