"""Reachability: what is remembered, what is drawn from it, how the network judges, and when it may be trusted."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium import spaces
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

import sprl_bench  # noqa: F401 - registers the ids
from sprl_baselines.bonus import Setting
from sprl_baselines.learning.rollout import Rollout, Rows
from sprl_baselines.reachability import GroundTruth, LearnedReachability, ReachabilityConfig, judge_pairs
from sprl_baselines.reachability.network import reachability_network
from sprl_baselines.reachability.replay import Replay, Segments
from sprl_baselines.reachability.triplets import Ranges, accuracy_ranges, scatter, training_ranges, walk
from sprl_bench import solver

CPU = torch.device("cpu")
LINE = spaces.Box(-1e6, 1e6, (1,), np.float32)


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


# -------------------------------------------------------------------------------------------- replay


def numbered(steps: int, num_envs: int, first: int = 0) -> Tensor:
    """States that say which they are: 1000 * sub-env + time."""
    return torch.arange(first, first + steps).unsqueeze(1) + 1000 * torch.arange(num_envs)


def replay_of(cuts: list[list[int]], size: int = 100) -> Replay:
    """Two sub-envs, T steps; `cuts[n]` are the steps of sub-env n after which a stretch ends."""
    flags = torch.zeros(8, 2, dtype=torch.bool)
    for env, steps in enumerate(cuts):
        flags[steps, env] = True
    replay = Replay(size, num_envs=2)
    replay.append(numbered(8, 2), flags)
    return replay


def stretches(replay: Replay, newest: int | None = None) -> list[list[int]]:
    segments = replay.segments(newest)
    return [
        replay.take(torch.arange(start, start + length)).tolist()
        for start, length in zip(*map(Tensor.tolist, segments), strict=True)
    ]


def test_stretches_end_at_cuts_at_the_newest_row_and_between_sub_envs() -> None:
    assert stretches(replay_of([[2, 3], [7]])) == [
        [0, 1, 2],
        [3],
        [4, 5, 6, 7],
        [1000, 1001, 1002, 1003, 1004, 1005, 1006, 1007],
    ]


def test_the_newest_rows_alone() -> None:
    assert stretches(replay_of([[2, 5], []]), newest=4) == [[4, 5], [6, 7], [1004, 1005, 1006, 1007]]
    assert stretches(replay_of([[], []]), newest=99) == stretches(replay_of([[], []]))


def test_the_oldest_rows_go_and_a_stretch_spans_rollouts() -> None:
    replay = replay_of([[1], []], size=20)
    replay.append(numbered(4, 2, first=8), torch.zeros(4, 2, dtype=torch.bool))
    assert replay.rows == replay.capacity == 10
    assert stretches(replay) == [list(range(2, 12)), list(range(1002, 1012))]


def test_a_replay_goes_on_from_its_state() -> None:
    first, second = replay_of([[2], [5]], size=20), Replay(20, 2)
    second.load_state_dict(first.state_dict(), CPU)
    for replay in (first, second):
        replay.append(numbered(3, 2, first=8), torch.ones(3, 2, dtype=torch.bool))
    assert stretches(first) == stretches(second)


# ------------------------------------------------------------------------------------------ triplets


@st.composite
def segments(draw: Any) -> Segments:
    lengths = torch.tensor(draw(st.lists(st.integers(1, 80), min_size=1, max_size=6)))
    gaps = torch.tensor(draw(st.lists(st.integers(0, 5), min_size=len(lengths), max_size=len(lengths))))
    return Segments((lengths + gaps).cumsum(0) - lengths, lengths)


@given(
    segments(),
    st.integers(1, 8),
    st.integers(1, 30),
    st.integers(0, 20),
    st.integers(1, 6),
    st.sampled_from(["episode", "double"]),
    st.integers(0, 99),
)
def test_algorithm_1_keeps_to_its_ranges(
    segments: Segments,
    k: int,
    tolerance: int,
    negative_bias: int,
    positive_bias: int,
    negatives: str,
    seed: int,
) -> None:
    ranges = training_ranges(k, tolerance, negative_bias, negatives)
    triplets = walk(segments, ranges, positive_bias, generator(seed))
    least = k + negative_bias + (tolerance if negatives == "double" else 0)
    most = {"episode": 10**6, "double": least + negative_bias}[negatives]
    by_stretch: dict[int, list[tuple[int, int]]] = {}
    for anchor, positive, negative in zip(*map(Tensor.tolist, triplets), strict=True):
        [home] = [
            start
            for start, length in zip(*map(Tensor.tolist, segments), strict=True)
            if start <= anchor and negative < start + length
        ]
        assert 1 <= positive - anchor <= k
        assert least <= negative - anchor <= most
        by_stretch.setdefault(home, []).append((anchor, positive))
    for start, length in zip(*map(Tensor.tolist, segments), strict=True):
        pairs = by_stretch.get(start, [])
        assert bool(pairs) == (length > least)  # the first state is an anchor where there is room
        assert not pairs or pairs[0][0] == start
        for (_, positive), (anchor, _) in itertools.pairwise(pairs):
            assert 1 <= anchor - positive <= positive_bias
        if pairs:  # and the last anchor is the last with room
            assert pairs[-1][1] + positive_bias + least >= start + length


def test_every_place_in_a_range_is_drawn() -> None:
    triplets = walk(
        Segments(torch.zeros(4000, dtype=torch.int64), torch.full((4000,), 12)), Ranges((1, 3), (5, 7)), 2, generator()
    )
    offsets = [set((places - triplets.anchors).tolist()) for places in triplets]
    assert offsets == [{0}, {1, 2, 3}, {5, 6, 7}]


def test_the_second_anchor_is_any_of_those_after_the_first() -> None:
    """Up to three steps after the positive, which lies 1 to 3 after the first anchor."""
    starts = 100 * torch.arange(2000)
    triplets = walk(Segments(starts, torch.full((2000,), 12)), Ranges((1, 3), (5, 7)), 3, generator())
    found: dict[int, int] = {}
    for anchor in triplets.anchors[2000:].tolist():  # the first of each stretch come first
        found.setdefault(anchor // 100, anchor % 100)
    assert set(found.values()) == {2, 3, 4, 5, 6}


def test_accuracy_is_measured_in_the_bands_of_appendix_b1() -> None:
    assert accuracy_ranges(k=2, tolerance=1, negative_bias=20) == Ranges((1, 3), (23, 43))


@given(segments(), st.integers(0, 99))
def test_scattered_anchors_have_room(segments: Segments, seed: int) -> None:
    triplets = scatter(segments, Ranges((1, 3), (8, 12)), 200, generator(seed))
    roomy = {
        start + offset
        for start, length in zip(*map(Tensor.tolist, segments), strict=True)
        for offset in range(max(length - 8, 0))
    }
    assert set(triplets.anchors.tolist()) <= roomy
    assert len(triplets.anchors) == (200 if roomy else 0)
    ends = segments.starts + segments.lengths
    for anchor, positive, negative in zip(*map(Tensor.tolist, triplets), strict=True):
        assert 1 <= positive - anchor <= 3
        assert 8 <= negative - anchor <= 12
        assert negative < int(ends[(segments.starts <= anchor).sum() - 1])


# ------------------------------------------------------------------------------------------- network


def line_network() -> Any:
    space = spaces.Box(-1, 1, (3,), np.float32)
    made = reachability_network(space, generator(), embedding_units=4, layers=2, units=5, pair_input="pair")
    made.first.bias.data.normal_(generator=generator(1))
    return made.eval()


def test_the_first_layer_split_by_state_is_that_of_the_pair() -> None:
    network = line_network()
    states = torch.randn(9, 3, generator=generator(2))
    earlier, later = torch.randint(9, (2, 20), generator=generator(3))
    expected = network.rest(network.first(torch.cat((states[earlier], states[later]), dim=1))).squeeze(-1)
    assert torch.allclose(network(states)(earlier, later), expected, atol=1e-5)


def test_the_difference_of_grids_goes_through_the_convolutions() -> None:
    """Appendix F.4: the input is (later, later - earlier), number by number, negative ones included."""
    space = spaces.Box(0, 255, (7, 7, 3), np.uint8)
    network = reachability_network(
        space, generator(), embedding_units=8, layers=2, units=5, pair_input="difference"
    ).eval()
    states = torch.randint(11, (6, 7, 7, 3), generator=generator(2), dtype=torch.uint8)
    earlier, later = torch.tensor([0, 1, 5, 2]), torch.tensor([3, 0, 4, 2])
    change = states[later].numpy().astype(np.float32) - states[earlier].numpy().astype(np.float32)
    both = torch.cat((network.embedding(states[later]), network.embedding(torch.from_numpy(change))), dim=1)
    expected = network.rest(network.first(both)).squeeze(-1)
    assert torch.allclose(network(states)(earlier, later), expected, atol=1e-5)


def test_the_flat_network_is_that_of_appendix_g4() -> None:
    space = spaces.Box(-1, 1, (16,), np.float32)
    network = reachability_network(space, generator(), embedding_units=1, layers=4, units=512, pair_input="pair")
    kinds = [type(module).__name__ for module in network.rest]
    assert kinds == ["BatchNorm1d", "ReLU", "Linear"] * 4
    weights = [network.first, *(module for module in network.rest if isinstance(module, torch.nn.Linear))]
    assert [tuple(layer.weight.shape) for layer in weights] == [(512, 32), (512, 512), (512, 512), (512, 512), (1, 512)]


def test_other_observations_are_refused() -> None:
    with pytest.raises(ValueError, match=r"observation_space is Discrete.*; it must be"):
        reachability_network(
            spaces.Discrete(3),
            generator(),
            embedding_units=1,
            layers=1,
            units=1,
            pair_input="pair",
        )


class Counting:
    """A reachability that says how often it was asked: |earlier - later| / 100."""

    ready = True

    def __init__(self) -> None:
        self.states, self.pairs = 0, 0

    def judge_of(self, states: Tensor) -> Any:
        self.states += len(states)

        def judge(earlier: Tensor, later: Tensor) -> Tensor:
            self.pairs += len(earlier)
            return (states[later] - states[earlier]).abs().squeeze(-1) / 100

        return judge


def test_repeated_states_and_pairs_are_judged_once() -> None:
    counting = Counting()
    judge = judge_pairs(counting, Rows.of(torch.tensor([[5.0], [9.0], [5.0], [9.0]])))  # type: ignore[arg-type]
    answers = judge(torch.tensor([0, 2, 0, 1]), torch.tensor([1, 3, 2, 0]))
    assert answers.tolist() == pytest.approx([0.04, 0.04, 0.0, 0.04])
    assert (counting.states, counting.pairs) == (2, 3)


# -------------------------------------------------------------------------------------- ground truth


def test_the_ground_truth_is_the_solvers() -> None:
    envs: Any = gymnasium.make_vec("SPRL/KeyDoors-7x7-v1", num_envs=1)
    rng = np.random.default_rng(0)
    envs.reset(seed=4)
    states = np.concatenate([envs.step(rng.integers(6, size=1))[0].copy() for _ in range(90)])
    earlier, later = rng.integers(len(states), size=(2, 200))
    judge = GroundTruth(envs.single_observation_space, k=3).judge_of(torch.from_numpy(states))
    answers = judge(torch.from_numpy(earlier), torch.from_numpy(later))
    assert answers.bool().tolist() == solver.reachable(states[earlier], states[later], 3).tolist()
    assert set(answers.tolist()) == {0.0, 1.0}


def test_the_ground_truth_needs_a_grid() -> None:
    with pytest.raises(ValueError, match=r"observation_space is Box.*; it must be \(S, S, 3\)"):
        GroundTruth(LINE, k=2)


# ----------------------------------------------------------------------------------------- learning


def walk_along_a_line(steps: int, num_envs: int, start: int = 0, rewards: Tensor | None = None) -> Rollout:
    """States are times, so what is near in time is near; nothing ends."""
    nothing = torch.zeros(steps, num_envs, dtype=torch.bool)
    times = torch.arange(start, start + steps + 1).float().view(-1, 1, 1).expand(-1, num_envs, 1) / 10
    return Rollout(
        observations=times[:-1],
        actions=torch.zeros(steps, num_envs),
        rewards=torch.zeros(steps, num_envs) if rewards is None else rewards,
        terminated=nothing,
        truncated=nothing,
        values=torch.zeros(steps, num_envs),
        log_probs=torch.zeros(steps, num_envs),
        last_observations=times[-1],
        final_observations=times[:0, 0],
        positions=torch.zeros(steps, num_envs, 0),
        next_positions=torch.zeros(steps, num_envs, 0),
    )


QUICK = {"replay_size": 400, "train_every": 200, "pair_batch": 32, "head_units": 32, "reachability_learning_rate": 0.01}


def learner(**settings: Any) -> LearnedReachability:
    config = ReachabilityConfig(**{**QUICK, **settings})
    return LearnedReachability(Setting(LINE, spaces.Discrete(2), 2, seed=0, device=CPU), config)


def test_it_learns_to_tell_near_from_far() -> None:
    learned = learner(ready_trainings=5, ready_accuracy=0.9)
    line = walk_along_a_line(100, 2)
    cut = line.truncated.clone()
    cut[-1] = True
    reports = [learned.update(replace(line, truncated=cut)) for _ in range(15)]
    assert reports[-1]["reachability_accuracy"] > 0.95
    assert reports[-1]["reachability_training_accuracy"] > 0.95
    assert learned.ready


def test_the_first_training_waits_for_a_half_full_replay_and_later_ones_for_their_time() -> None:
    learned = learner(replay_size=1000, train_every=300)
    trained = [bool(learned.update(walk_along_a_line(50, 2, start=50 * index))) for index in range(12)]
    assert trained == [False] * 5 + [True] + [False] * 2 + [True] + [False] * 2 + [True]


def test_the_interval_grows() -> None:
    learned = learner(train_every=6_000, later_from=1_000_000, last_from=2_000_000)
    intervals = []
    for steps in (0, 1_000_000, 1_000_001, 2_000_000, 2_000_001):
        learned._steps = steps
        intervals.append(learned._interval())
    assert intervals == [6_000, 6_000, 12_000, 12_000, 36_000]


def test_it_is_ready_for_good_once_enough_trainings_were_right() -> None:
    learned = learner(ready_trainings=3, ready_accuracy=0.75)
    states = []
    for accuracy in (1.0, 1.0, 0.1, 0.1, 0.9, 0.9, 0.9, 0.0):
        learned._gradient_step = lambda _, accuracy=accuracy: torch.tensor([0.0, accuracy])  # type: ignore[method-assign]
        learned.update(walk_along_a_line(120, 2))
        states.append(learned.ready)
    assert states == [False] * 6 + [True, True]


def test_nothing_is_learned_where_stretches_are_too_short() -> None:
    learned = learner()
    reports = [learned.update(walk_along_a_line(120, 2, rewards=torch.ones(120, 2))) for _ in range(3)]
    assert reports[-1] == {"reachability_triplets": 0.0, "reachability_ready": 0.0}
    assert not learned.ready


def test_smoothed_labels_are_nearer_to_each_other() -> None:
    """Against the loss by hand: targets 0.95 and 0.05."""
    learned = learner(label_smoothing=0.1)
    learned.update(walk_along_a_line(100, 2))
    batch = learned._draw().take(torch.arange(16))
    learned.network.train()
    logits, labels = learned._logits(batch)
    targets = torch.where(labels == 1, 0.95, 0.05)
    share = logits.sigmoid()
    expected = -(targets * share.log() + (1 - targets) * (1 - share).log()).mean().detach()
    assert float(learned._gradient_step(batch)[0]) == pytest.approx(float(expected), rel=1e-5)
    assert labels.sum() == 16


def test_a_resumed_network_learns_on_exactly() -> None:
    first, second = learner(), learner()
    for index in range(3):
        first.update(walk_along_a_line(100, 2, start=100 * index))
    second.load_state_dict(first.state_dict())
    for index in range(3, 6):
        rollout = walk_along_a_line(100, 2, start=100 * index)
        assert first.update(rollout) == second.update(rollout)
    parameters = zip(first.network.state_dict().values(), second.network.state_dict().values(), strict=True)
    assert all(torch.equal(*pair) for pair in parameters)


def test_a_network_resumed_between_two_trainings_goes_on_exactly() -> None:
    """Its schedule, what came in since the last training, and the accuracies that it waits for."""
    settings = {"replay_size": 2000, "train_every": 500, "ready_trainings": 2, "ready_accuracy": 0.0}
    first, second = learner(**settings), learner(**settings)
    for index in range(7):
        first.update(walk_along_a_line(100, 2, start=100 * index))
    assert (len(first._accuracies), first._fresh_rows) == (1, 100)
    second.load_state_dict(first.state_dict())
    reports = [
        [made.update(walk_along_a_line(100, 2, start=100 * index)) for index in range(7, 12)]
        for made in (first, second)
    ]
    assert reports[0] == reports[1]
    assert [bool(report) for report in reports[0]] == [False, True, False, False, True]
    assert first.ready
    assert second.ready


def test_accuracy_is_measured_on_what_no_training_has_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """On the rows since the last training, before the next one, in the bands of appendix B.1."""
    learned = learner(tolerance=2)
    measured, steps_taken = [], []

    def gradient_steps() -> int:
        return max((int(moment["step"]) for moment in learned._optimizer.state.values()), default=0)

    def spy(segments: Segments, ranges: Ranges, count: int, generator: torch.Generator) -> Any:
        oldest = round(10 * float(learned._replay.take(segments.starts.min()[None])))
        measured.append((oldest, int(segments.lengths.sum()), ranges, count, gradient_steps()))
        return scatter(segments, ranges, count, generator)

    monkeypatch.setattr("sprl_baselines.reachability.learned.scatter", spy)
    for index in range(4):
        learned.update(walk_along_a_line(100, 2, start=100 * index))
        steps_taken.append(gradient_steps())
    band = accuracy_ranges(2, 2, 20)
    assert measured == [
        (0, 400, band, 15_000, 0),
        (200, 200, band, 15_000, steps_taken[1]),
        (300, 200, band, 15_000, steps_taken[2]),
    ]


@pytest.mark.parametrize("negatives", ["episode", "double"])
def test_training_draws_as_its_settings_say(negatives: str, monkeypatch: pytest.MonkeyPatch) -> None:
    learned = learner(k=4, tolerance=3, negative_bias=6, positive_bias=3, negatives=negatives, max_pairs=40)
    asked = []

    def spy(segments: Segments, ranges: Ranges, positive_bias: int, generator: torch.Generator) -> Any:
        asked.append((ranges, positive_bias))
        return walk(segments, ranges, positive_bias, generator)

    monkeypatch.setattr("sprl_baselines.reachability.learned.walk", spy)
    learned.update(walk_along_a_line(100, 2))
    assert len(learned._draw().anchors) == 20
    assert asked == [(training_ranges(4, 3, 6, negatives), 3)]


def test_learning_on_leaves_a_loaded_state_as_it_was() -> None:
    first, second = learner(), learner()
    for index in range(3):
        first.update(walk_along_a_line(100, 2, start=100 * index))
    state = first.state_dict()
    second.load_state_dict(state)
    before = [value.clone() for moment in state["optimizer"].values() for value in moment.values()]
    second.update(walk_along_a_line(100, 2))
    after = [value for moment in state["optimizer"].values() for value in moment.values()]
    assert before
    assert all(torch.equal(*pair) for pair in zip(before, after, strict=True))


def test_weights_decay_and_nothing_else() -> None:
    plain, decaying = learner(), learner(weight_decay=10.0)
    for made in (plain, decaying):
        assert [bool(made.update(walk_along_a_line(100, 2))) for _ in range(4)][-1]
    kept, shrunk = (made.network.rest[2].weight.norm() for made in (plain, decaying))
    assert shrunk < kept
    weights, others = decaying._optimizer.param_groups
    assert (weights["weight_decay"], others["weight_decay"]) == (10.0, 0)
    assert {parameter.ndim for parameter in others["params"]} == {1}


@pytest.mark.parametrize(
    ("settings", "complaint"),
    [
        ({"pair_batch": 128, "max_pairs": 100}, "pair_batch is 128; it must be at most max_pairs, 100"),
        (
            {"replay_size": 44},
            "replay_size is 44; it must be more than 44, num_envs times the 22 steps to the nearest negative",
        ),
        (
            {"replay_size": 46, "negatives": "double"},
            "replay_size is 46; it must be more than 46, num_envs times the 23 steps to the nearest negative",
        ),
    ],
)
def test_what_could_never_learn_is_refused(settings: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        learner(**settings)
