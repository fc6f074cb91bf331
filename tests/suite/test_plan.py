"""The runs that make up a suite: every seed of every task and agent, and what is refused."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sprl_bench.naming import AgentName
from sprl_bench.suite import devices, expand, require_device, too_short
from sprl_bench.tasks import SUITES, find_suite

pytestmark = pytest.mark.usefixtures("fakes")

SMOKE = find_suite("smoke")
WALKER, BROKEN, DYING = (f"harness_fakes:{name}" for name in ("walker", "broken", "dying"))


def test_expand_gives_every_seed_of_every_task_and_agent() -> None:
    specs = expand(find_suite("grid-7x7"), ["random", WALKER], [0, 4])
    assert [(spec.seed, spec.task.name, spec.agent) for spec in specs] == [
        (seed, task, agent)
        for seed in (0, 4)
        for task in ("FourRooms-7x7", "KeyDoors-7x7")
        for agent in ("random", "walker")
    ]
    assert {(spec.suite, spec.suite_version) for spec in specs} == {("grid-7x7", 1)}
    assert [spec.source for spec in specs[:2]] == ["random", WALKER]
    assert [spec.num_envs for spec in specs[:2]] == [12, 3]
    assert {(spec.device, spec.torch_threads) for spec in specs} == {("cpu", 1)}


def test_expand_resolves_the_presets_of_the_domain() -> None:
    (spec,) = expand(SMOKE, ["ppo"], [0], overrides={"learning_rate": 0.5})
    assert spec.hyperparameters["learning_rate"] == 0.5
    assert len(spec.hyperparameters) > 10
    assert spec.num_envs == spec.hyperparameters["num_envs"]


def test_an_agent_with_another_preset_is_an_agent_of_its_own() -> None:
    table, ablation = expand(SMOKE, ["sprl", "sprl@ablation"], [0])
    assert (table.agent, ablation.agent) == ("sprl", "sprl@ablation")
    assert (table.source, ablation.source) == ("sprl", "sprl")
    assert (table.hyperparameters["k"], ablation.hyperparameters["k"]) == (2, 5)
    (spec,) = expand(SMOKE, ["sprl@ablation"], [0], overrides={"k": 3})
    assert spec.hyperparameters == {**ablation.hyperparameters, "k": 3}


def test_a_variant_is_an_agent_of_its_own_and_its_record_says_what_differs() -> None:
    named = ["sprl", "sprl+tolerance=25+k=5", "sprl@ablation+cost_scale=1", f"{WALKER}+rollout=7", "random+num_envs=3"]
    plain, longer, scaled, walker, random = expand(SMOKE, named, [0])
    agents = ["sprl", "sprl+k=5+tolerance=25", "sprl@ablation+cost_scale=1.0", "walker+rollout=7", "random+num_envs=3"]
    assert [spec.agent for spec in (plain, longer, scaled, walker, random)] == agents
    assert [spec.preset for spec in (plain, longer, scaled, walker, random)] == ["table", "table", "ablation", "", ""]
    assert (plain.differences, longer.differences) == ({}, {"k": 5, "tolerance": 25})
    assert longer.hyperparameters == {**plain.hyperparameters, "k": 5, "tolerance": 25}
    assert (scaled.differences, scaled.hyperparameters["k"]) == ({"cost_scale": 1.0}, 5)
    assert (walker.differences, walker.hyperparameters["rollout"], walker.source) == ({"rollout": 7}, 7, WALKER)
    assert (random.differences, random.hyperparameters, random.num_envs) == ({"num_envs": 3}, {"num_envs": 3}, 3)


def test_a_setting_for_all_agents_is_a_difference_that_is_not_in_the_name() -> None:
    (spec,) = expand(SMOKE, ["sprl+k=5"], [0], overrides={"tolerance": 25, "tolerance_samples": 60})
    assert (spec.agent, spec.differences) == ("sprl+k=5", {"k": 5, "tolerance": 25})


def test_large_and_small_numbers_keep_their_plus_and_minus() -> None:
    (spec,) = expand(SMOKE, [f"{WALKER}+pause_s=1e+20+after=-3"], [0])
    assert spec.agent == "walker+after=-3+pause_s=1e20"
    assert spec.differences == {"pause_s": 1e20, "after": -3}
    (again,) = expand(SMOKE, [f"harness_fakes:{spec.agent}"], [0])
    assert again == spec.model_copy(update={"source": again.source})


settings = st.fixed_dictionaries(
    {},
    optional={
        "k": st.sampled_from([1, 3, 5]),
        "cost_scale": st.sampled_from([0.1, 0.5, 1.0]),
        "negatives": st.sampled_from(["double"]),
        "anneal_learning_rate": st.sampled_from([True, False]),
        "num_envs": st.sampled_from([3, 6]),
    },
)


@given(settings, st.sampled_from(["sprl", "sprl@ablation"]))
def test_a_variant_runs_as_its_settings_given_one_by_one(chosen: dict[str, Any], agent: str) -> None:
    (one_by_one,) = expand(SMOKE, [agent], [0], overrides=chosen)
    name = AgentName(agent.partition("@")[0], agent.partition("@")[2], one_by_one.differences)
    (variant,) = expand(SMOKE, [str(name)], [0])
    assert AgentName.parse(variant.agent) == name
    assert variant == one_by_one.model_copy(update={"agent": variant.agent})


def test_seeds_may_be_numpys() -> None:
    assert [spec.seed for spec in expand(SMOKE, [WALKER], np.arange(2))] == [0, 1]


def test_expand_takes_some_tasks_only() -> None:
    specs = expand(find_suite("grid"), ["random"], [0], tasks=["KeyDoors-11x11"])
    assert [spec.task.name for spec in specs] == ["KeyDoors-11x11"]


def test_another_budget_is_another_task_of_no_suite() -> None:
    (spec,) = expand(SMOKE, ["random"], [0], budget=500)
    assert (spec.suite, spec.suite_version, spec.task.name, spec.task.budget) == ("custom", 0, "FourRooms-7x7-500", 500)
    (spec,) = expand(SMOKE, ["random"], [0], budget=100_000)
    assert (spec.suite, spec.task.name) == ("smoke", "FourRooms-7x7")


def test_an_agent_without_an_opinion_on_num_envs_gets_twelve_or_what_is_asked_for() -> None:
    (spec,) = expand(SMOKE, ["harness_fakes:forgetful"], [0])
    assert (spec.num_envs, "num_envs" in spec.hyperparameters) == (12, False)
    (spec,) = expand(SMOKE, ["harness_fakes:forgetful"], [0], overrides={"num_envs": 5})
    assert (spec.num_envs, "num_envs" in spec.hyperparameters) == (5, False)
    (spec,) = expand(SMOKE, [WALKER], [0], overrides={"num_envs": 5})
    assert (spec.num_envs, spec.hyperparameters["num_envs"]) == (5, 5)


def test_a_hyperparameter_without_a_default_can_be_set() -> None:
    (spec,) = expand(SMOKE, ["harness_fakes:demanding"], [0], overrides={"width": 3, "depth": 2, "num_envs": 5})
    assert (spec.hyperparameters, spec.num_envs) == ({"width": 3, "depth": 2}, 5)
    (spec,) = expand(SMOKE, ["harness_fakes:parallel"], [0], overrides={"num_envs": 5})
    assert (spec.hyperparameters, spec.num_envs) == ({"num_envs": 5}, 5)
    with pytest.raises(ValueError, match="must be given: num_envs"):
        expand(SMOKE, ["harness_fakes:parallel"], [0])


@pytest.mark.parametrize("device", ["cpu", "cuda", "cuda:1"])
def test_devices_are_taken_as_they_are_named(device: str) -> None:
    (spec,) = expand(SMOKE, ["random"], [0], device=device)
    assert spec.device == device


@pytest.mark.parametrize(
    ("gpus", "device", "message"),
    [
        (0, "cuda", "device is 'cuda'; it must be one that torch finds here: auto, cpu."),
        (1, "cuda:1", "device is 'cuda:1'; it must be one that torch finds here: auto, cpu, cuda:0."),
    ],
)
def test_a_gpu_that_is_not_here_is_refused(
    gpus: int, device: str, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(devices, "_gpus", lambda: gpus)
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        require_device(device)


@pytest.mark.parametrize(("gpus", "device"), [(0, "cpu"), (0, "auto"), (1, "auto"), (1, "cuda"), (2, "cuda:1")])
def test_a_device_that_is_here_is_accepted(gpus: int, device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(devices, "_gpus", lambda: gpus)
    require_device(device)


def test_privileged_agents_are_marked() -> None:
    assert [spec.privileged for spec in expand(SMOKE, [BROKEN, DYING], [0])] == [True, False]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"seeds": [0, 1, 0]}, "seeds holds 0 more than once"),
        ({"seeds": []}, "seeds is empty"),
        ({"seeds": [-1]}, "seed: "),
        ({"agents": [WALKER, "elsewhere:walker"]}, "agents holds 'walker' more than once"),
        ({"agents": ["sprl@ablation", "sprl@ablation"]}, "agents holds 'sprl@ablation' more than once"),
        ({"agents": ["sprl@ablatoin"]}, "'ablatoin'; did you mean 'ablation'"),
        ({"agents": ["spr@ablation"]}, "Unknown agent 'spr'; did you mean 'sprl'"),
        ({"agents": ["sprl@"]}, "agents holds 'sprl@'; it must have the name of a preset after the @"),
        ({"agents": ["sprl+"]}, "agents holds 'sprl\\+'; it must be AGENT, AGENT@PRESET or AGENT@PRESET\\+KEY=VALUE"),
        ({"agents": ["sprl+k"]}, "agents holds 'sprl\\+k'; it must be AGENT, "),
        ({"agents": ["+k=3"]}, "agents holds '\\+k=3'; it must be AGENT, "),
        ({"agents": ["sprl+=3"]}, "agents holds 'sprl\\+=3', where a difference is '=3'; it must be KEY=VALUE"),
        ({"agents": ["sprl+k=3+k=4"]}, "where a difference gives 'k' twice"),
        ({"agents": ["sprl+k=0"]}, "Hyperparameter k is 0; it must be a whole number, at least 1"),
        ({"agents": ["sprl+k=many"]}, "Hyperparameter k is 'many'; it must be a whole number"),
        ({"agents": ["sprl+k="]}, "Hyperparameter k is ''; it must be a whole number"),
        ({"agents": ["sprl+tolerence=3"]}, "Unknown hyperparameter 'tolerence'; did you mean 'tolerance'"),
        ({"agents": ["sprl+k=2"]}, "agents holds 'sprl\\+k=2', the same as 'sprl'; it must be 'sprl'"),
        ({"agents": ["sprl@ablation+k=5+tolerance=3"]}, "the same as 'sprl@ablation\\+tolerance=3'; it must be"),
        ({"agents": ["sprl+k=3+bias=1", "sprl+bias=1.0+k=3"]}, "agents holds 'sprl\\+bias=1.0\\+k=3' more than once"),
        (
            {"agents": ["sprl+k=3"], "overrides": {"k": 4}},
            "overrides holds 'k'; the agent 'sprl\\+k=3' must not give it",
        ),
        ({"agents": ["sprl@table+k=3"]}, "agents holds 'sprl@table'; it must be 'sprl', whose preset is 'table'"),
        ({"agents": [f"{WALKER}+trouble=a/b"]}, "agent: 'walker\\+trouble=a/b' cannot name a folder"),
        ({"agents": [f"{WALKER}+tempo=1"]}, "Unknown hyperparameter 'tempo'"),
        ({"agents": ["random@table"]}, "preset is 'table'; it must be left out, as this agent has no presets"),
        ({"agents": [f"{WALKER}@table"]}, "preset is 'table'; it must be left out, as this agent has no presets"),
        ({"agents": ["sprl"], "overrides": {"preset": "table"}}, "must be named behind the agent, as in AGENT@table"),
        ({"agents": ["pppo"]}, "Unknown agent 'pppo'; did you mean 'ppo'"),
        ({"tasks": ["FourRooms"]}, "Unknown task of suite 'smoke': 'FourRooms'; did you mean 'FourRooms-7x7'"),
        ({"overrides": {"rolout": 3}}, "Unknown hyperparameter 'rolout'; did you mean 'rollout'"),
        ({"overrides": {"num_envs": 0}}, "num_envs: "),
        ({"overrides": {"num_envs": 2.5}}, "num_envs: "),
        ({"agents": ["harness_fakes:anything"], "overrides": {"seed": 3}}, "Unknown hyperparameter 'seed'"),
        ({"budget": 0}, "task.budget: |budget"),
        ({"torch_threads": 0}, "torch_threads: "),
        ({"device": "gpu"}, "device is 'gpu'; it must be auto, cpu, cuda or cuda:N"),
        ({"device": "cuda:"}, "device is 'cuda:'; it must be"),
        ({"device": "cpu\n"}, "device is "),
        ({"agents": ["harness_fakes:demanding"]}, "without a default must be given: depth, width"),
        ({"agents": ["harness_fakes:demanding"], "overrides": {"width": 3}}, "must be given: depth"),
        ({"agents": ["harness_fakes:demanding"], "overrides": {"widht": 3}}, "did you mean 'width'"),
    ],
)
def test_bad_arguments_are_named_in_one_line(changes: dict[str, Any], message: str) -> None:
    arguments: dict[str, Any] = {"agents": [WALKER], "seeds": [0], **changes}
    with pytest.raises(ValueError, match=message) as raised:
        expand(SMOKE, **arguments)
    assert "\n" not in str(raised.value)


def test_the_preset_of_a_plain_name_has_no_second_name() -> None:
    with pytest.raises(ValueError, match="agents holds 'sprl@table'; it must be 'sprl', whose preset is 'table'"):
        expand(SMOKE, ["sprl@table"], [0])


def test_a_budget_that_ends_before_the_network_is_used_is_named() -> None:
    """The step is the one that runs have shown (notes): 147,456 on grids; 132,096 and 27,648 on Fetch."""
    smoke = expand(SUITES["smoke"], ["ppo", "gt-sprl", "sprl+k=3", "random", "eco"], [0, 1])
    assert too_short(smoke) == [
        "sprl+k=3, eco on FourRooms-7x7: nothing is learned about their networks, which are not in use before env step "
        "147,456 of 100,000."
    ]
    assert too_short(expand(SUITES["grid-7x7"], ["sprl", "eco"], [0])) == []
    fetch = SUITES["fetch-sparse"]
    for agent, first in (("sprl", 132_096), ("sprl@scaled", 27_648)):
        assert too_short(expand(fetch, [agent], [0], budget=first + 1)) == []
        assert all(f"before env step {first:,}" in one for one in too_short(expand(fetch, [agent], [0], budget=first)))
        assert len(too_short(expand(fetch, [agent], [0], budget=first))) == 4
