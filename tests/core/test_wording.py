import pytest

from ema_core.faults import fault_vector
from ema_core.parameters import ActuatorParameters
from ema_core.wording import unknown_name


def test_unknown_name_says_what_was_probably_meant():
    known = ("friction", "R_s")
    assert unknown_name("thing", "fricton", known).startswith(
        "unknown thing 'fricton'; did you mean 'friction'? known: friction, R_s"
    )
    assert "did you mean 'R_s'?" in unknown_name("thing", "Rs", known)
    assert "did you mean" not in unknown_name("thing", "colour", known)


def test_slips_in_faults_and_parameters_are_recognised():
    with pytest.raises(ValueError, match="did you mean 'eccentricity'"):
        fault_vector({"excentricity": 0.1})
    with pytest.raises(ValueError, match="did you mean 'R_s'"):
        ActuatorParameters().replace({"rs": 2.0})
