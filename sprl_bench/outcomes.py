"""Whether a run solved its task, and when it first reached the goal: shares and times, each with its interval.

A share of few seeds has Wilson's interval (Wilson 1927; Brown, Cai and DasGupta, Interval Estimation for a Binomial
Proportion, 2001), which stays within 0 and 1. A run that ends before it reaches the goal is censored: it counts as
"later than the budget", never as "at the budget" (Kaplan and Meier, 1958).
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from statistics import NormalDist
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sprl_bench.scores import BINS, Interval

SOLVED: Final = 0.5
"""A run has solved its task if at least this share of the episodes succeeds in the last tenth of the budget."""


def wilson_interval(successes: int, total: int, confidence: float = 0.95) -> Interval:
    """Return Wilson's interval of a share.

    Raises:
        ValueError: There is nothing to take a share of.
    """
    if not 0 <= successes <= total or total < 1:
        raise ValueError(f"successes is {successes} of {total}; it must be from 0 to a total of at least 1.")
    z = NormalDist().inv_cdf((1 + confidence) / 2)
    centre = (successes + z * z / 2) / (total + z * z)
    half = z / (total + z * z) * (successes * (total - successes) / total + z * z / 4) ** 0.5
    return Interval(centre - half if successes else 0.0, centre + half if successes < total else 1.0)


def first_goal(success_curve: npt.ArrayLike, budget: int) -> int | None:
    """Return the env step at which the first bin with a success ends, or None if no episode succeeds.

    The resolution is a hundredth of the budget.
    """
    reached = np.flatnonzero(np.asarray(success_curve, dtype=np.float64) > 0)
    return int((reached[0] + 1) * budget // BINS) if reached.size else None


class MedianTime(NamedTuple):
    """When half of the runs have reached the goal.

    Attributes:
        median: Env steps; None where fewer than half have reached it.
        low: Lower end of the interval; None where it lies beyond the budget.
        high: Upper end of the interval; None where it lies beyond the budget.
        reached: How many runs have reached the goal.
        total: How many runs there are.
    """

    median: float | None
    low: float | None
    high: float | None
    reached: int
    total: int


def kaplan_meier(times: Sequence[int | None], budget: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return the times, ascending, and the share of runs that have not reached the goal by each: [K] both.

    Args:
        times: [S], env steps; None for a run that is censored at the budget.
        budget: Env steps.
    """
    estimate = _survival(times, budget)
    return np.asarray(estimate.quantiles, np.float64), np.asarray(estimate.probabilities, np.float64)


def median_time(times: Sequence[int | None], budget: int, confidence: float = 0.95) -> MedianTime:
    """Return the Kaplan-Meier median with its interval.

    The interval holds the times at which the survival curve's log-log interval holds one half (Brookmeyer and Crowley,
    A Confidence Interval for the Median Survival Time, 1982).

    Args:
        times: [S], env steps; None for a run that is censored at the budget.
        budget: Env steps.
        confidence: The probability that the interval aims to cover.

    Raises:
        ValueError: There is no run.
    """
    if not times:
        raise ValueError("times is empty; it must hold at least one run.")
    reached = sum(time is not None for time in times)
    if not reached:
        return MedianTime(None, None, None, 0, len(times))
    estimate = _survival(times, budget)
    with warnings.catch_warnings():
        # Where no run is left the band is not defined: there its lower end is 0, and its upper end stays as it was.
        warnings.filterwarnings("ignore", "The confidence interval is undefined", RuntimeWarning)
        band = estimate.confidence_interval(confidence, method="log-log")
    ends = np.nan_to_num(band.low.probabilities), _carried(band.high.probabilities)
    median, low, high = (_crossing(estimate.quantiles, one) for one in (estimate.probabilities, *ends))
    return MedianTime(median, low, high, reached, len(times))


def _survival(times: Sequence[int | None], budget: int) -> Any:
    """Return scipy's estimate of the survival function."""
    from scipy import stats  # noqa: PLC0415 - slow to load

    known = [time for time in times if time is not None]
    censored: Any = stats.CensoredData(uncensored=known, right=[budget] * (len(times) - len(known)))
    return stats.ecdf(censored).sf


def _carried(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return values [K] in which each NaN repeats the one before it; 1 where there is none before."""
    known = np.maximum.accumulate(np.where(np.isnan(values), -1, np.arange(len(values))))
    return np.where(known >= 0, values[known], 1.0)


def _crossing(times: npt.NDArray[np.float64], survival: npt.NDArray[np.float64]) -> float | None:
    """Return the first time at which at most half is left, or None."""
    below = np.flatnonzero(survival <= 0.5 + 1e-12)
    return float(times[below[0]]) if below.size else None
