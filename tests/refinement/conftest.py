import pytest

from hlp.refinement.cost import CostSettings
from hlp.refinement.verification import VerificationSettings


@pytest.fixture
def cost_settings():
    return CostSettings(roi_size=96)


@pytest.fixture
def verification():
    return VerificationSettings(candidates=5, roi_size=96)
