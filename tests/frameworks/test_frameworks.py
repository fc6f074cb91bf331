"""What the pages of docs/frameworks say can be done: each script trains, and its runs are replayed equal, step by step.

Frameworks that need an environment of their own are skipped; `make frameworks` makes one for each and runs them there.
"""

from __future__ import annotations

import itertools
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Final

import pytest
from pages import blocks_of, pages, text_of, words_of

from sprl_bench.records import find_records

HERE: Final = {"cleanrl", "gymnasium", "stable-baselines3"}  # what they need is installed for other tests too
ELSEWHERE: Final = {"minari", "rllib", "skrl", "tianshou", "torchrl"}
TASKS: Final = ("FetchReach-", "FourRooms-7x7-")
COMMAND: Final = [sys.executable, "-m", "sprl_bench"]
INSTALL: Final = re.compile(r"^Install it: `pip install (?:-c constraints\.txt )?(.+)`\.$", re.MULTILINE)
BLOCK: Final = """
import gymnasium
import sprl_bench

if __name__ == "__main__":
    with sprl_bench.recording(out="runs", agent="refused", seed=0):
        {}
"""
PROCESSES: Final = r"recording\(\) (cannot record there|does not reach into other processes)"
REFUSED: Final = {
    "SubprocVecEnv": (
        "stable-baselines3",
        "from stable_baselines3.common import env_util, vec_env",
        "env_util.make_vec_env(ID, 2, vec_env_cls=vec_env.SubprocVecEnv)",
        PROCESSES,
    ),
    "SubprocVectorEnv": (
        "tianshou",
        "from tianshou.env import SubprocVectorEnv",
        "SubprocVectorEnv([lambda: gymnasium.make(ID)] * 2)",
        PROCESSES,
    ),
    "block-around-experiment": (
        "tianshou",
        "from tianshou.highlevel import config, env, experiment",
        "experiment.PPOExperimentBuilder(env.EnvFactoryRegistered(task=ID, venv_type=env.VectorEnvType.DUMMY), "
        "experiment.ExperimentConfig(watch=False, persistence_enabled=False), "
        "config.OnPolicyTrainingConfig(max_epochs=1, num_training_envs=2)).build().run()",
        "not stepped in turn",
    ),
    "collector-of-episodes": (
        "tianshou",
        "from tianshou.algorithm.algorithm_base import RandomActionPolicy as Policy; from tianshou import data, env",
        "envs = env.DummyVectorEnv([lambda: gymnasium.make(ID)] * 3); envs.seed(0); "
        "data.Collector(Policy(envs.action_space[0]), envs).collect(n_episode=4, reset_before_collect=True)",
        "not stepped in turn",
    ),
    "GymEnv-num_envs": ("torchrl", "from torchrl.envs import GymEnv", "GymEnv(ID, num_envs=2)", PROCESSES),
    "GymEnv-num_workers": ("torchrl", "from torchrl.envs import GymEnv", "GymEnv(ID, num_workers=2)", PROCESSES),
    "ParallelEnv": (
        "torchrl",
        "from functools import partial; from torchrl.envs import GymEnv, ParallelEnv",
        "ParallelEnv(2, partial(GymEnv, ID)).reset()",  # it starts its processes here
        PROCESSES,
    ),
    "GymWrapper-set_seed": (
        "torchrl",
        "from torchrl.envs import GymWrapper",
        "GymWrapper(gymnasium.make_vec(ID, num_envs=2)).set_seed(0)",
        "seed is 0, but recorded steps have been taken",
    ),
}


def call(words: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        words,
        check=False,
        cwd=folder,
        env={**os.environ, "MINARI_DATASETS_PATH": str(folder / "minari")},
        capture_output=True,
        text=True,
        timeout=500,
    )


def run(words: list[str], folder: Path) -> str:
    done = call(words, folder)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    return done.stdout


def skip_unless_asked(name: str) -> None:
    if os.environ.get("SPRL_FRAMEWORK") != ("here" if name in HERE else name):
        pytest.skip("make frameworks runs this")


def scripts_of(name: str) -> list[str]:
    """Return the scripts of a page, without the modules that it saves under a name."""
    found = [block.code for block in blocks_of(f"docs/frameworks/{name}.md") if block.language == "python"]
    return [code for code in found if not code.startswith("# ")]


@pytest.mark.parametrize("name", sorted(HERE | ELSEWHERE))
def test_the_scripts_of_a_page_train_and_are_scored(name: str, tmp_path: Path) -> None:
    skip_unless_asked(name)
    agents = set()
    for number, code in enumerate(scripts_of(name)):
        agents |= set(re.findall(r'agent="([^"]+)"', code))
        (tmp_path / f"script{number}.py").write_text(code)
        run([sys.executable, f"script{number}.py"], tmp_path)
    records = find_records(tmp_path / "runs")
    found = [(one.spec.agent, one.spec.task.name.rstrip("0123456789")) for one in records]
    assert sorted(found) == sorted(itertools.product(agents, TASKS))
    assert {one.status for one in records} == {"complete"}
    assert all(one.totals.episodes > 10 for one in records)
    assert f"{len(records)} of {len(records)} runs are replayed equal." in run([*COMMAND, "verify", "runs"], tmp_path)


@pytest.mark.parametrize(("name", "imports", "line", "message"), REFUSED.values(), ids=REFUSED)
def test_what_a_page_says_cannot_be_recorded_raises_an_error(
    name: str, imports: str, line: str, message: str, tmp_path: Path
) -> None:
    skip_unless_asked(name)
    (tmp_path / "script.py").write_text(f'{imports}\nID = "SPRL/FetchReachSparse-v1"\n{BLOCK.format(line)}')
    done = call([sys.executable, "script.py"], tmp_path)
    assert done.returncode == 1
    assert re.search(f"Error: .*{message}", done.stderr), done.stderr[-4000:]
    assert not [one for one in find_records(tmp_path) if one.status == "complete"]


def test_an_agent_of_stable_baselines3_runs_on_the_command_line(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    agent = [block for block in blocks_of("docs/frameworks/stable-baselines3.md") if block.language == "python"][-1]
    (tmp_path / "my_sb3.py").write_text(agent.code)
    words = ["run", "--suite", "smoke", "--agents", "my_sb3:Learner", "--seeds", "1", "--budget", "3000"]
    run([*COMMAND, *words, "--device", "cpu", "--out", "runs"], tmp_path)
    assert [one.status for one in find_records(tmp_path / "runs")] == ["complete"]


def test_every_page_has_a_test_and_every_framework_a_page() -> None:
    names = {Path(page).stem for page in pages(("docs/frameworks/*.md",))}
    assert names - {"README"} == HERE | ELSEWHERE
    [made] = re.findall(r"^FRAMEWORKS := (.+)$", text_of("Makefile"), re.MULTILINE)
    assert set(made.split()) == ELSEWHERE


@pytest.mark.parametrize("name", sorted(HERE | ELSEWHERE))
def test_the_table_of_frameworks_installs_what_the_page_installs(name: str) -> None:
    [packages] = INSTALL.findall(text_of(f"docs/frameworks/{name}.md"))
    [row] = [line for line in text_of("docs/frameworks/README.md").splitlines() if f"({name}.md)" in line]
    assert row.endswith(f"| `{packages}` |")


@pytest.mark.parametrize("page", pages(("docs/frameworks/*.md",)))
def test_a_page_is_short(page: str) -> None:
    assert words_of(page) < 450
