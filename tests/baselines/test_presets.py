"""Presets against the paper's tables, copied out here once more by hand."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import pytest

from sprl_baselines.agents import eco, gt_grid, gt_sprl, icm, ppo, sprl

AGENTS: dict[str, Any] = {
    "eco": eco, "gt-grid": gt_grid, "gt-sprl": gt_sprl, "icm": icm, "ppo": ppo, "sprl": sprl,
}  # fmt: skip
SHORT = {"lr": "learning_rate", "entropy": "entropy_coefficient", "b": "forward_share", "W": "icm_loss_weight"}

TABLE_1 = {
    "ppo": {"lr": 0.003, "entropy": 0.01},
    "icm": {"lr": 0.003, "entropy": 0.01, "b": 0.8, "W": 0.3, "bonus_weight": 0.1},
    "gt-grid": {"lr": 0.003, "entropy": 0.01, "bonus_weight": 0.01},
    "eco": {"lr": 0.003, "entropy": 0.01, "k": 3, "bonus_weight": 0.001},
    "sprl": {
        "lr": 0.01, "entropy": 0.01, "k": 2, "tolerance": 1, "negative_bias": 20, "positive_bias": 5,
        "cost_scale": 0.002, "tolerance_samples": 60,
    },
}  # fmt: skip
TABLE_2 = {
    "sprl": {
        "lr": 0.0003, "entropy": 0.004, "k": 10, "tolerance": 1, "negative_bias": 20, "positive_bias": 5,
        "cost_scale": 0.06, "tolerance_samples": 200,
    },
}  # fmt: skip
ATARI = {"k": 12, "tolerance": 1, "negative_bias": 80, "positive_bias": 5}
TABLE_4 = {
    "ppo": {"lr": 0.0005, "entropy": 0.01},
    "icm": {"lr": 0.0005, "entropy": 0.01, "b": 1.0, "W": 1.0, "bonus_weight": 0.01},
    "eco": {"lr": 0.0005, "entropy": 0.01, "bonus_weight": 0.001, **ATARI},
    "sprl": {"lr": 0.0005, "entropy": 0.01, "cost_scale": 0.05, "tolerance_samples": 200, **ATARI},
}
FETCH = {"k": 10, "tolerance": 1, "negative_bias": 12, "positive_bias": 5, "bias": 1.0}
TABLE_5 = {
    "ppo": {"lr": 0.0005, "entropy": 0.01, "action_noise": 0.003},
    "icm": {"lr": 0.0005, "entropy": 0.001, "action_noise": 0.003, "b": 1.0, "W": 1.0, "bonus_weight": 0.001},
    "eco": {"lr": 0.0005, "entropy": 0.001, "action_noise": 0.003, "bonus_weight": 0.0001, **FETCH},
    "sprl": {"lr": 0.0005, "entropy": 0.001, "cost_scale": 0.05, "tolerance_samples": 20, **FETCH},
}
ROWS = [
    (domain, agent, values)
    for domain, table in (("grid", TABLE_1), ("dmlab", TABLE_2), ("atari", TABLE_4), ("fetch", TABLE_5))
    for agent, values in table.items()
]


@pytest.mark.parametrize(("domain", "agent", "values"), ROWS)
def test_the_default_preset_is_the_papers_table(domain: str, agent: str, values: dict[str, float]) -> None:
    resolved = AGENTS[agent].hyperparameters(domain, {})
    assert {name: resolved[SHORT.get(name, name)] for name in values} == values
    assert AGENTS[agent].hyperparameters(domain, {}, "table") == resolved


@pytest.mark.parametrize("agent", ["sprl", "gt-sprl"])
def test_the_ablation_preset_is_one_long_stretch(agent: str) -> None:
    resolved = AGENTS[agent].hyperparameters("grid", {}, "ablation")
    assert (resolved["k"], resolved["tolerance"], resolved["tolerance_samples"]) == (5, 25, 1)
    assert resolved["cost_scale"] == 0.002


def test_the_tuned_preset_is_among_what_was_swept() -> None:
    from sweep_agents_grid import SETTINGS

    for agent, settings in SETTINGS.items():
        resolved = AGENTS[agent].hyperparameters("grid", {}, "tuned")
        table = AGENTS[agent].hyperparameters("grid", {})
        chosen = [setting for setting in settings if resolved == {**table, **setting}]
        assert len(chosen) == 1, f"{agent}: {chosen}"


def test_the_ground_truth_differs_from_sprl_in_its_network_alone() -> None:
    learned, true = (AGENTS[agent].hyperparameters("grid", {}) for agent in ("sprl", "gt-sprl"))
    assert true.items() <= learned.items()


def test_rewards_are_normalised_on_fetch_alone() -> None:
    kinds = {domain: ppo.hyperparameters(domain, {})["reward_normalization"] for domain in ("grid", "fetch", "atari")}
    assert kinds == {"grid": "none", "fetch": "extrinsic", "atari": "none"}


def test_every_network_of_the_fetch_tasks_is_that_of_appendix_g4() -> None:
    for agent in (eco, sprl):
        resolved = agent.hyperparameters("fetch", {})
        assert (resolved["head_layers"], resolved["head_units"], resolved["replay_size"]) == (4, 512, 30_000)
        assert resolved["max_pairs"] == 30_000
    for agent in (eco, icm, ppo, sprl):
        resolved = agent.hyperparameters("fetch", {})
        assert (resolved["mlp_layers"], resolved["mlp_units"]) == (4, 256)


@pytest.mark.parametrize("domain", ["dmlab", "atari"])
def test_the_reachability_network_for_images_has_three_wide_layers(domain: str) -> None:
    """Appendix E.4, which F.4 takes over."""
    for agent in (eco, sprl):
        resolved = agent.hyperparameters(domain, {})
        assert [resolved[name] for name in ("embedding_units", "head_layers", "head_units")] == [512, 3, 512]


def test_all_agents_of_a_domain_share_the_frame() -> None:
    names = ("num_envs", "rollout_length", "clip_range", "anneal_clip_range", "anneal_learning_rate")
    frames: dict[str, set[tuple[Any, ...]]] = {}
    for domain, agent, _ in ROWS:
        resolved = AGENTS[agent].hyperparameters(domain, {})
        frames.setdefault(domain, set()).add(tuple(resolved[name] for name in names))
    assert frames == {
        "grid": {(12, 128, 0.2, True, True)},
        "dmlab": {(12, 256, 0.1, True, True)},
        "atari": {(12, 256, 0.1, True, True)},
        "fetch": {(12, 256, 0.2, False, False)},
    }


def test_gradients_are_cut_at_ten_where_the_authors_did_so() -> None:
    cuts = {(domain, agent): AGENTS[agent].hyperparameters(domain, {})["max_grad_norm"] for domain, agent, _ in ROWS}
    assert {where for where, cut in cuts.items() if cut != 0.5} == {("dmlab", "sprl")}
    assert cuts["dmlab", "sprl"] == 10


@pytest.mark.parametrize(
    ("agent", "domain", "preset"),
    [("gt-sprl", "fetch", "table"), ("gt-sprl", "atari", "table"), ("ppo", "grid", "ablation")],
)
def test_an_agent_without_such_a_preset_is_told_who_has_one(agent: str, domain: str, preset: str) -> None:
    with pytest.raises(
        ValueError, match=rf"agent is '{agent}'; it must be one with the preset '{preset}' of domain '{domain}': .*sprl"
    ):
        AGENTS[agent].hyperparameters(domain, {}, preset)


def test_the_page_of_all_hyperparameters_is_as_written() -> None:
    """If this fails: python docs/write_hyperparameters.py docs/hyperparameters.md."""
    docs = Path(__file__).parents[2] / "docs"
    page = runpy.run_path(str(docs / "write_hyperparameters.py"))["page"]()
    assert (docs / "hyperparameters.md").read_text() == page
    for agent in AGENTS.values():
        for name in agent.hyperparameters("grid", {}):
            assert f"\n| `{name}` | " in page
