"""A budget of samples as strata: powers of four, few sizes, none lost."""

from __future__ import annotations

import pytest

from burnish.core.errors import InvalidValue
from burnish.precompute.accumulate import STRATA
from burnish.precompute.bake import strata, whole_strata


@pytest.mark.parametrize("spp", [1, 2, 3, 5, 15, 16, 17, 64, 100, 255, 256, 257, 300, 511, 4096])
def test_a_budget_is_rounded_up_to_whole_strata_of_two_sizes(spp: int) -> None:
    parts = strata(spp)
    assert set(parts) <= {1, 4, 16, 64, STRATA}
    assert len(set(parts)) <= 2
    assert max(parts) <= 4 * min(parts)
    assert spp <= sum(parts) <= max(1.25 * spp, spp + 1)
    assert strata(sum(parts)) == parts


@pytest.mark.parametrize("spp", [0.2, 1.0, 7.9, 63.0, 100.4, 300.0, 5000.0])
def test_what_fits_in_a_time_splits_without_rest(spp: float) -> None:
    samples = whole_strata(spp)
    assert samples <= max(spp, 1)
    assert samples > spp - max(spp / 4, 1)
    assert sum(strata(samples)) == samples


def test_no_samples_are_refused() -> None:
    with pytest.raises(InvalidValue, match="spp must be at least 1"):
        strata(0)
