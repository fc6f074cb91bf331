"""Videos: what is in them is what happened, and each mistake is one sentence with nothing left behind."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from sprl_bench.cli import main
from sprl_bench.policies import UnplayableRunError, find_actor, find_run
from sprl_bench.records import RunSpec, write
from sprl_bench.records.folder import RECORD
from sprl_bench.run import InterruptedRunError, run
from sprl_bench.tasks import CUSTOM, find_suite, with_budget
from sprl_bench.video import CannotDrawError, Episode, record_video

imageio = pytest.importorskip("imageio.v2")
imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
pytestmark = pytest.mark.usefixtures("fakes")

GRID = "SPRL/FourRooms-7x7-v1"
FETCH = "SPRL/FetchReachSparse-v1"
OWN, WALKER = "film_fakes:actor", "harness_fakes:walker"
Capture = pytest.CaptureFixture[str]


def frames(path: Path, size: int = 224) -> list[np.ndarray]:
    """Return the pictures in a film; a .gif keeps those that follow an equal one only as a longer delay."""
    if path.suffix.lower() == ".gif":
        with imageio.get_reader(path) as film:
            return [np.asarray(frame)[..., :3] for frame in film]
    pictures, _ = decode(path)
    return list(np.frombuffer(pictures, np.uint8).reshape(-1, size, size, 3))


def decode(path: Path) -> tuple[bytes, str]:
    """Return the bytes of all pictures, and what ffmpeg says of the film."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-i", str(path), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    done = subprocess.run(command, capture_output=True, check=True)
    return done.stdout, done.stderr.decode()


# Once a session, before any capture: on its first import Gymnasium-Robotics prints a notice of its own.
@pytest.fixture(scope="session")
def fetch() -> None:
    pytest.importorskip("mujoco")
    pytest.importorskip("gymnasium_robotics")


@pytest.mark.parametrize("suffix", [".gif", ".mp4", ".GIF"])
def test_a_film_shows_each_state_of_each_episode(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / "new" / f"film{suffix}"
    filmed = record_video(GRID, path, policy="solver", episodes=3, seed=5)
    env = gymnasium.make(GRID, render_mode="rgb_array")
    policy = find_actor("solver").begin(env, 5)
    expected, pictures = [], []
    for seed in (5, None, None):
        observation, _ = env.reset(seed=seed)
        pictures.append(env.render())
        steps, ended = 0, False
        while not ended:
            observation, reward, ended, _, _ = env.step(policy(observation))
            pictures.append(env.render())
            steps += 1
        expected.append(Episode(steps, reward, True))
    assert filmed == expected
    shown = frames(path)
    assert len(shown) == len(pictures)
    blur = 12 if suffix == ".mp4" else 2
    for frame, picture in zip(shown, pictures, strict=True):
        assert frame.shape == picture.shape
        assert np.abs(frame.astype(int) - picture).mean() < blur
    assert list(path.parent.iterdir()) == [path]


def test_time_runs_as_in_the_environment(tmp_path: Path, fetch: None) -> None:
    """167 actions make a second there: a .gif shows every fourth state, a .mp4 every third, and both the last."""
    chosen = {"policy": "random", "arguments": {"substep": 3, "max_episode_steps": 10}}
    record_video(FETCH, tmp_path / "a.gif", **chosen)
    with imageio.get_reader(tmp_path / "a.gif") as film:
        assert (len(list(film)), film.get_meta_data()["duration"]) == (4, 20)  # 0, 4, 8, 10; 24 ms are no choice
    record_video(FETCH, tmp_path / "a.mp4", **chosen)
    pictures, said = decode(tmp_path / "a.mp4")
    assert len(pictures) == 5 * 480 * 480 * 3  # 0, 3, 6, 9, 10
    told = re.search(r"([\d.]+) fps", said)
    assert told
    assert float(told[1]) == pytest.approx(167 / 3, abs=0.01)
    record_video(GRID, tmp_path / "b.gif", policy="solver")
    with imageio.get_reader(tmp_path / "b.gif") as film:
        assert film.get_meta_data()["duration"] == 100  # ten a second


def test_the_random_policy_follows_from_the_seed(tmp_path: Path) -> None:
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        record_video(GRID, tmp_path / f"{name}.gif", seed=seed, arguments={"max_episode_steps": 12})
    first, again, other = ((tmp_path / f"{name}.gif").read_bytes() for name in "abc")
    assert first == again
    assert first != other


def test_still_does_nothing(tmp_path: Path, fetch: None) -> None:
    [episode] = record_video(GRID, tmp_path / "a.gif", policy="still")
    assert episode == Episode(100, 0.0, False)
    assert len(frames(tmp_path / "a.gif")) == 1  # equal pictures are one
    env = gymnasium.make(FETCH)
    assert np.array_equal(find_actor("still").begin(env, 0)(None), np.zeros(4, np.float32))


def test_a_policy_of_one_s_own(tmp_path: Path) -> None:
    record_video(GRID, tmp_path / "a.mp4", policy="film_fakes:turn", arguments={"max_episode_steps": 4})
    start, *between, end = frames(tmp_path / "a.mp4")
    assert len(between) == 3
    assert np.abs(start.astype(int) - end).max() < 100  # four turns to the left
    assert all(np.abs(start.astype(int) - other).max() > 100 for other in between)
    [episode] = record_video(GRID, tmp_path / "b.gif", policy=lambda _: 0, arguments={"max_episode_steps": 4})
    assert episode == Episode(4, 0.0, False)
    for name in ("film_fakes:FORWARD", "film_fakes:backward"):
        with pytest.raises(ValueError, match=f"policy is '{name}'; it must be"):
            find_actor(name)
    with pytest.raises(ValueError, match=r"'film_fakes:'; it must be package.module:attribute"):
        find_actor("film_fakes:")


def test_a_film_that_fails_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "a.gif"
    path.write_text("what was there")
    with pytest.raises(ValueError, match="policy is 'film_fakes:failing'; it raised ZeroDivisionError") as failure:
        record_video(GRID, path, policy="film_fakes:failing")
    assert isinstance(failure.value.__cause__, ZeroDivisionError)
    assert path.read_text() == "what was there"
    assert list(tmp_path.iterdir()) == [path]
    record_video(GRID, path, policy="solver")
    assert path.read_bytes().startswith(b"GIF89a")


def test_a_machine_that_cannot_draw_is_told_from_a_wrong_request(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def render(_: object) -> None:
        raise AttributeError("no attribute 'eglQueryString'")

    monkeypatch.setattr("minigrid.minigrid_env.MiniGridEnv.render", render)
    with pytest.raises(CannotDrawError, match=r"cannot be drawn here \(AttributeError: .*eglQueryString.*doctor"):
        record_video(GRID, tmp_path / "a.mp4")
    assert list(tmp_path.iterdir()) == []


# What an agent has learned


def make_spec(agent: str = "actor", seed: int = 0, env_id: str = GRID, **arguments: Any) -> RunSpec:
    task = replace(with_budget(find_suite("smoke").tasks[0], 600), env_id=env_id, arguments=arguments)
    return RunSpec.of(
        CUSTOM,
        task,
        hyperparameters={"num_envs": 3},
        agent=agent,
        source=f"{'film' if agent == 'actor' else 'harness'}_fakes:{agent}",
        privileged=False,
        seed=seed,
        num_envs=3,
    )


def interrupt(spec: RunSpec, out: Path) -> Path:
    """Train for a while, and return the folder."""
    with pytest.raises(InterruptedRunError):
        run(spec, out, stop=lambda: True)
    return spec.path(out)


def test_what_an_agent_has_learned_acts(tmp_path: Path) -> None:
    folder = interrupt(make_spec(), tmp_path / "runs")
    env = gymnasium.make(GRID, render_mode="rgb_array")
    assert find_actor(str(folder), OWN).begin(env, 0)(None) == 2  # ahead: it has the state of one update
    [episode] = record_video(
        GRID, tmp_path / "a.gif", policy=str(folder), agent=OWN, arguments={"max_episode_steps": 3}
    )
    assert episode.steps <= 3
    with pytest.raises(ValueError, match=r"is a run in SPRL/FourRooms-7x7-v1, not in SPRL/KeyDoors-7x7-v1"):
        record_video("SPRL/KeyDoors-7x7-v1", tmp_path / "b.gif", policy=str(folder), agent=OWN)


def test_a_finished_run_keeps_what_its_agent_has_learned(tmp_path: Path) -> None:
    spec = make_spec()
    run(spec, tmp_path)
    folder = spec.path(tmp_path)
    assert not (folder / "checkpoint.safetensors").exists()
    assert find_actor(str(folder), OWN).begin(gymnasium.make(GRID), 0)(None) == 2


def test_a_run_is_recorded_even_if_its_agent_cannot_show_what_it_has_learned(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def weights(_: object) -> None:
        raise TypeError("these weights are a property")

    monkeypatch.setattr("film_fakes.Actor.weights", weights)
    spec = make_spec()
    run(spec, tmp_path)
    assert (spec.path(tmp_path) / "record.json").exists()
    assert "keeps no weights, so it cannot be filmed: these weights are a property" in caplog.text


def test_an_agent_acts_in_the_environment_of_its_run(tmp_path: Path, fetch: None) -> None:
    spec = make_spec(env_id=FETCH, substep=250)
    folder = spec.path(tmp_path)
    write(folder / "spec.json", spec)
    (folder / "checkpoint.safetensors").touch()
    assert find_actor(str(folder), OWN).arguments == {"substep": 250}


def test_a_run_that_cannot_act_says_why(tmp_path: Path) -> None:
    finished = make_spec("walker", seed=1)
    run(finished, tmp_path)
    with pytest.raises(UnplayableRunError, match=r"has no trained agent 'walker': it must hold weights.safetensors"):
        find_actor(str(finished.path(tmp_path)), WALKER)
    folder = interrupt(make_spec("walker"), tmp_path)
    env = gymnasium.make(GRID)
    with pytest.raises(UnplayableRunError, match=r"Agent 'walker' cannot act"):
        find_actor(str(folder), WALKER).begin(env, 0)


def test_a_run_is_found_below_a_folder(tmp_path: Path) -> None:
    specs = [make_spec(), make_spec("walker"), make_spec("walker", seed=1)]
    for spec in specs:
        write(spec.path(tmp_path) / "spec.json", spec)
    assert find_run(tmp_path, GRID, "actor") == specs[0].path(tmp_path)
    assert find_run(specs[2].path(tmp_path), GRID) == specs[2].path(tmp_path)
    for name in ("sprl", "sprl@ablation"):
        preset = make_spec().model_copy(update={"agent": name, "source": "sprl"})
        write(preset.path(tmp_path / "presets") / "spec.json", preset)
    assert find_run(tmp_path / "presets", GRID, "sprl").parent.name == "sprl"
    assert find_run(tmp_path / "presets", GRID, "sprl@ablation").parent.name == "sprl@ablation"
    with pytest.raises(ValueError, match=r"more than one run of walker in SPRL/FourRooms-7x7-v1; .*seed-0, .*seed-1$"):
        find_run(tmp_path, GRID, "walker")
    with pytest.raises(FileNotFoundError, match="holds no run of ppo in SPRL/FourRooms-7x7-v1"):
        find_run(tmp_path, GRID, "ppo")
    with pytest.raises(FileNotFoundError, match=r"holds no run in SPRL/FourRooms-7x7-v1\.$"):
        find_run(tmp_path / "nowhere", GRID)


def test_an_error_says_that_recorded_scripts_do_not_count(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / RECORD).touch()
    with pytest.raises(FileNotFoundError, match="Recorded scripts do not count"):
        find_run(tmp_path, GRID)


def test_no_code_is_loaded_because_a_run_names_it(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "strange.py").write_text("raise SystemExit('this code ran')\n")
    monkeypatch.chdir(tmp_path)
    spec = make_spec().model_copy(update={"source": "strange:code"})
    folder = spec.path(tmp_path / "runs")
    write(folder / "spec.json", spec)
    (folder / "weights.safetensors").touch()
    told = f"The agent of {folder} is 'strange:code': your own code is loaded only if you name it"
    with pytest.raises(UnplayableRunError, match=re.escape(told)):
        record_video(GRID, tmp_path / "a.gif", policy=str(folder))
    with pytest.raises(UnplayableRunError, match=re.escape(told)):
        record_video(GRID, tmp_path / "a.gif", policy=str(folder), agent="film_fakes:actor")
    status, _, err = call(capsys, GRID, "--run", "runs", "-o", "a.gif")
    assert (status, err.count("\n"), "as --agent strange:code" in err) == (1, 1, True)
    assert "strange" not in sys.modules
    with pytest.raises(
        ValueError, match="agent is 'ppo'; it must be left out, as policy 'random' is not the folder of a run"
    ):
        find_actor("random", "ppo")
    actor = interrupt(make_spec(), tmp_path / "more")
    with pytest.raises(UnplayableRunError, match="film_fakes:actor"):
        find_actor(actor, "ppo")
    assert find_run(tmp_path / "runs", GRID, "strange:code") == folder
    with pytest.raises(SystemExit, match="this code ran"):
        call(capsys, GRID, "--run", "runs", "--agent", "strange:code", "-o", "a.gif")


# The command


def call(capsys: Capture, *words: object) -> tuple[int, str, str]:
    status = main(["video", *map(str, words)])
    out, err = capsys.readouterr()
    return status, out, err


def test_the_command_films_and_tells_of_each_episode(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.gif"
    status, out, err = call(capsys, GRID, "--policy", "solver", "--episodes", 2, "--seed", 3, "-o", path)
    assert (status, err) == (0, f"Wrote {path}.\n")
    assert [line.split(":")[0] for line in out.splitlines()] == ["episode 1", "episode 2"]
    assert out.count(", success") == 2
    status, out, _ = call(capsys, GRID, "--arg", "max_episode_steps=4", "-o", path)
    assert (status, out) == (0, "episode 1: 4 steps, return 0, no success\n")
    interrupt(make_spec(), tmp_path / "runs")
    words = [GRID, "--agent", OWN, "--run", tmp_path / "runs", "--arg", "max_episode_steps=4", "-o", path]
    assert call(capsys, *words)[0] == 0
    (tmp_path / "my_own_policy.py").write_text("def turn(observation):\n    return 0\n")
    monkeypatch.chdir(tmp_path)
    status, out, _ = call(capsys, GRID, "--policy", "my_own_policy:turn", "-o", "b.gif")
    assert (status, out) == (0, "episode 1: 100 steps, return 0, no success\n")


@pytest.mark.parametrize(
    ("words", "status", "message"),
    [
        (["SPRL/FourRoms-7x7-v1"], 2, "Unknown environment 'SPRL/FourRoms-7x7-v1'; did you mean 'SPRL/FourRooms-7x7"),
        (["sprl_bench:SPRL/Rooms-v1"], 2, "Rooms"),
        (["nowhere:SPRL/Rooms-v1"], 1, "nowhere"),
        (
            [GRID, "--arg", "size=3"],
            2,
            "keyword argument 'size' (value 3); it takes observation, render_mode.",
        ),
        ([FETCH, "--arg", "n_substeps=3"], 2, "Did you mean 'substep'?"),
        ([FETCH, "--arg", "substep=0"], 2, "substep is 0; it must be an integer from 1 to 500."),
        ([FETCH, "--arg", "substep=2.5"], 2, "substep is 2.5; it must be an integer from 1 to 500."),
        ([FETCH, "--arg", "substep"], 2, "--arg is 'substep'; it must be KEY=VALUE."),
        ([GRID, "--arg", "render_mode=human"], 2, "render_mode"),
        ([GRID, "--policy", "randm"], 2, "Unknown policy 'randm'; did you mean 'random'?"),
        ([GRID, "--policy", "nowhere:policy"], 1, "No module named 'nowhere'"),
        ([FETCH, "--policy", "solver"], 2, "There is no policy 'solver' for SPRL/FetchReachSparse-v1"),
        ([GRID, "--agent", "ppo"], 2, "agent is 'ppo'; it must come with --run and the folder of its run."),
        ([GRID, "--policy", "random", "--run", "."], 2, "policy is 'random'; it must be left out if --run is given."),
        ([GRID, "--run", "nowhere"], 1, "nowhere holds no run in SPRL/FourRooms-7x7-v1."),
        ([GRID, "--episodes", 0], 2, "--episodes"),
        ([GRID, "--seed", -1], 2, "--seed"),
        ([GRID, "-o", "a.avi"], 2, "Unknown suffix of a video: '.avi'; allowed: .gif, .mp4."),
        ([GRID, "-o", "film"], 2, "Unknown suffix of a video: ''; allowed: .gif, .mp4."),
        ([GRID, "-o", "folder.gif"], 1, "folder.gif: Is a directory."),
        ([GRID, "-o", "file/a.gif"], 1, "file: "),
    ],
)
def test_a_mistake_is_one_line_and_leaves_nothing_behind(
    words: list[object],
    status: int,
    message: str,
    capsys: Capture,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    fetch: None,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("folder.gif").mkdir()
    Path("file").touch()
    before = sorted(tmp_path.rglob("*"))
    found, out, err = call(capsys, "-o", "a.mp4", *words)
    assert (found, out, err.count("\n")) == (status, "", 1)
    assert message in err
    assert sorted(tmp_path.rglob("*")) == before


def test_a_missing_library_says_how_to_get_it(capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    status, _, err = call(capsys, GRID, "-o", tmp_path / "a.mp4")
    assert status == 1
    assert "imageio_ffmpeg is not installed; install it with: pip install -c constraints.txt 'sprl-bench[video]'" in err
    assert list(tmp_path.iterdir()) == []


def test_bad_numbers_are_refused(tmp_path: Path) -> None:
    for number, message in (
        ({"episodes": 0}, "episodes.* 0"),
        ({"episodes": 2.5}, r"episodes.* 2\.5"),
        ({"seed": -1}, "seed.* -1"),
        ({"seed": 1.5}, r"seed.* 1\.5"),
        ({"policy": 3}, "policy is 3; it must be a name"),
        ({"arguments": {"render_mode": "human"}}, "render_mode is 'human'"),
    ):
        with pytest.raises((TypeError, ValueError), match=message):
            record_video(GRID, tmp_path / "a.gif", **number)  # type: ignore[arg-type]
