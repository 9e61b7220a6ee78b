import pytest

from hlp.commands.composing import compose_config
from hlp.commands.hydra_errors import hydra_in_words
from hlp.commands.nearest import nearest


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("refinement.particels=3", "refinement.particels is no key: did you mean refinement.par"),
        ("refinment=icp", "refinment is no key: did you mean refinement?"),
        ("refinement=icpp", "refinement=icpp is no alternative: did you mean icp? There are icp, "),
        ("foo", "cannot use 'foo': settings are given as KEY=VALUE"),
        ("a=[1", "cannot read 'a=[1' (no viable alternative at input '[1'): close all brackets"),
    ],
)
def test_errors_of_overrides_are_one_line_with_what_was_meant(override: str, words: str) -> None:
    from hydra.errors import HydraException

    with pytest.raises(HydraException) as caught:
        compose_config(override)
    said = hydra_in_words(caught.value)
    assert said.startswith(words)
    assert "\n" not in said


def test_a_key_of_another_alternative_is_said_to_be_one() -> None:
    from hydra.errors import HydraException

    with pytest.raises(HydraException) as caught:
        compose_config("refinement=icp", "refinement.particles=8")
    said = hydra_in_words(caught.value)
    assert said.startswith("refinement.particles is no key of the chosen refinement: `hlp run")


def test_several_values_of_one_key() -> None:
    error = ValueError("Ambiguous value for argument 'seed=1,2'\n1. To use it as a list, use …")
    said = hydra_in_words(error)
    assert "add -m for a sweep" in said and "seed=[1,2]" in said


def test_other_errors_stay_as_they_are() -> None:
    assert hydra_in_words(ValueError("something\nelse")) == "something\nelse"


def test_exchanged_letters_are_near_and_other_words_are_not() -> None:
    assert nearest("rnu", ["report", "run"]) == ": did you mean run?"
    assert nearest("zebra", ["report", "run"]) == ""
