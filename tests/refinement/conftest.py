import pytest

from hlp.refinement.cost import CostSettings
from hlp.refinement.verification import VerificationSettings
from refinement_scene import Scene, make_scene


@pytest.fixture(scope="session")
def scene() -> Scene:
    return make_scene(0)


@pytest.fixture
def cost_settings() -> CostSettings:
    return CostSettings(roi_size=96)


@pytest.fixture
def verification() -> VerificationSettings:
    return VerificationSettings(candidates=5, roi_size=96)
