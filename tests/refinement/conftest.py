import pytest

from hlp.refinement.cost import CostSettings
from hlp.refinement.verification import VerificationSettings
from refinement_scene import Scene, make_scene


@pytest.fixture(scope="session")
def scene() -> Scene:
    return make_scene(0)


@pytest.fixture
def cost_settings() -> CostSettings:
    return CostSettings(
        weight_depth=0.8,
        weight_edge=0.2,
        tau_depth_mm=30.0,
        tau_edge_mm=15.0,
        edge_step_mm=15.0,
        missing_cost=0.5,
        occluder_cost=0.5,
        uncovered_cost=1.0,
        reference_mm=30.0,
        roi_size=96,
        roi_margin_mm=30.0,
    )


@pytest.fixture
def verification() -> VerificationSettings:
    return VerificationSettings(
        candidates=5,
        max_improvement=0.1,
        weight_depth=0.8,
        weight_edge=0.3,
        weight_color=0.2,
        tau_depth_mm=20.0,
        tau_edge_mm=15.0,
        tau_color=0.3,
        edge_step_mm=15.0,
        missing_cost=0.3,
        occlusion_cost=0.1,
        occlusion_share_cost=0.2,
        occluded_edge_cost=0.5,
        unexplained_cost=0.2,
        support_cost=0.01,
        roi_size=96,
    )
