"""The learning rate of a training, for any number of steps."""

import pytest
import torch

from hlp.models.one_cycle import one_cycle


@pytest.mark.parametrize("rise", [0.1, 0.2])
@pytest.mark.parametrize("steps", [1, 2, 5, 9, 10, 11, 20, 100])
def test_the_rate_rises_and_falls_to_nothing(steps, rise):
    optimizer = torch.optim.AdamW([torch.zeros(1, requires_grad=True)], lr=1.0)
    schedule = one_cycle(optimizer, 1.0, steps, rise)["lr_scheduler"]["scheduler"]
    rates = []
    for _ in range(steps):
        rates.append(optimizer.param_groups[0]["lr"])
        optimizer.step()
        schedule.step()
    assert all(0.0 <= rate <= 1.0 for rate in rates)
    if steps >= 20:
        top = rates.index(max(rates))
        assert max(rates) > 0.9 and abs(top - rise * steps) <= 2 and rates[-1] < 0.05
        assert rates[:top] == sorted(rates[:top]) and rates[top:] == sorted(rates[top:])[::-1]
