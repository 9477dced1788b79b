# SPDX-License-Identifier: Apache-2.0
"""Design of test commands, and the predicted results of a test."""

import math

import numpy as np
import pytest

from ema_core.commands import THESIS_CHIRP, Command
from ema_core.faults import BACKLASH, COMPONENTS, FAULTS, SHORT_CIRCUITS, healthy_faults
from ema_core.parameters import ActuatorParameters
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.design.certificate import CauseProspect, Certificate, Naming
from ema_monitor.design.designing import Design, _Search
from ema_monitor.design.information import Information
from ema_monitor.design.limits import SHORTEST_S, Demands, MotionLimits
from ema_monitor.design.rehearsal import (
    HALF_WIDTH,
    N_COMBINED,
    FaultProspect,
    Prospect,
    Rehearsed,
    combined_faults,
    present,
    single_faults,
)

PARAMETERS = ActuatorParameters()


@pytest.fixture(scope="module")
def information() -> Information:
    return Information(Calibration.builtin())


@pytest.fixture(scope="module")
def limits() -> MotionLimits:
    return MotionLimits.within(PARAMETERS, travel=0.02, current=15.0, speed=400.0)


def test_demands_of_a_swing_follow_from_its_motion(information):
    swing = Command("swing", amplitude=0.004, start_frequency=4.0, end_frequency=12.0)
    demands = information.demands(information.windows(swing))
    assert demands.travel == pytest.approx(0.008, rel=1e-3)
    assert demands.longest == pytest.approx(0.5)
    assert demands.torque == pytest.approx(PARAMETERS.k_t * demands.current)
    # The motor follows a slow swing: its largest speed is the command's times the gear ratio.
    fastest = np.max(np.abs(np.diff(swing.sample(1e-4)))) / 1e-4 / PARAMETERS.tau
    assert demands.speed == pytest.approx(fastest, rel=0.25)


@pytest.mark.parametrize(
    ("limit", "parts"),
    [
        ({"travel": 0.0}, ("travel = 0 rad", "above 0")),
        ({"travel": 0.001}, ("travel = 0.001 rad", "0.0015 rad")),
        ({"travel": 2.0}, ("travel = 2 rad", "1.2 rad")),
        ({"travel": 0.01, "current": 30.0}, ("current = 30 A", "22.5 A")),
        ({"travel": 0.01, "torque": -1.0}, ("torque = -1 N.m", "above 0")),
        ({"travel": 0.01, "longest": 0.01}, ("longest = 0.01 s", f"{SHORTEST_S:g} s")),
    ],
)
def test_impossible_limit_is_refused_by_name_value_and_unit(limit, parts):
    with pytest.raises(ValueError, match=r"expected|limit|least") as refused:
        MotionLimits.within(PARAMETERS, **limit)
    for part in parts:
        assert part in str(refused.value)


def test_limits_that_are_not_given_are_nine_tenths_of_those_of_the_actuator():
    limits = MotionLimits.within(PARAMETERS, travel=0.01)
    assert limits.current == pytest.approx(0.9 * PARAMETERS.I_max)
    assert limits.speed == pytest.approx(0.9 * PARAMETERS.omega_max)


def made(sigma: dict[str, float], calibration: Calibration) -> Rehearsed:
    """Return a rehearsal with the given standard deviations."""

    class Made(Rehearsed):
        @property
        def faults(self):
            return tuple(
                FaultProspect(name, math.isfinite(sigma[name]), sigma[name], 0.0, 0.0, ())
                for name in COMPONENTS
            )

    nothing = Prospect(np.zeros(8), [])
    window = Information(calibration).windows(THESIS_CHIRP)[0]
    return Made(calibration, window, nothing, {}, [])


@pytest.fixture(scope="module")
def search(limits, information) -> _Search:
    calibration = Calibration.builtin()
    sigma = dict.fromkeys(COMPONENTS, 0.005)
    return _Search(made(sigma, calibration), THESIS_CHIRP, limits, dict.fromkeys(COMPONENTS, 0.01))


def test_points_are_swings_that_end_at_a_turning_point(search, limits):
    for point in np.random.default_rng(3).random((50, 5)):
        command = search.command(point)
        halves = (command.start_frequency + command.end_frequency) * command.duration
        assert halves == pytest.approx(round(halves), abs=1e-5)
        assert SHORTEST_S - 1e-4 <= command.duration <= limits.longest
        assert 2.0 * command.amplitude <= limits.travel * 1.001
        assert command.end_frequency > command.start_frequency


@pytest.mark.long
def test_search_finds_a_short_swing_within_the_limits(search, limits, information):
    point = np.full(5, 0.5)
    for best, _ in search.run(point):
        point = best
    assert search.is_feasible(point)
    command = search.command(point)
    demands = information.demands(information.windows(command))
    assert max(demands.shares(limits).values()) <= 1.002
    # Twice the chirp's standard deviation: at most a fourth of its time.
    assert command.duration < 0.5 * THESIS_CHIRP.duration


def design(sigma, wanted, demands, limits) -> Design:
    calibration = Calibration.builtin()
    values = dict.fromkeys(COMPONENTS, 0.005) | sigma
    return Design(
        THESIS_CHIRP,
        wanted,
        limits,
        demands,
        made(values, calibration),
        None,
        dict.fromkeys(COMPONENTS, 0.3),
    )


def test_unreachable_sigma_is_refused_with_fault_and_limit(limits):
    demands = Demands(travel=0.01, current=14.9, torque=1.1, speed=300.0, longest=0.5)
    refused = design({"gain": 0.004}, {"friction": 0.01, "gain": 0.002}, demands, limits)
    assert not refused.reached
    assert refused.binding == ["current", "longest"]
    assert refused.verdict == (
        "gain: sigma 0.002 is not reached, at best 0.0040; limited by current 15 A, longest 0.5 s"
    )
    hidden = design({"gain": math.nan}, {"gain": 0.002}, demands, limits)
    assert hidden.worst == ("gain", pytest.approx(150.0))
    assert "gain: sigma 0.002 is not reached, not shown at all" in hidden.verdict
    assert design({}, {"friction": 0.005}, demands, limits).reached


def test_design_allows_for_errors_outside_its_intervals():
    honest = FaultProspect(COMPONENTS[0], True, 0.002, 0.003, 0.01, ())
    wrong = honest._replace(error=0.00658)
    assert honest.effective == 0.002
    assert wrong.effective == pytest.approx(0.004)
    assert math.isnan(honest._replace(shown=False).effective)


def test_single_faults_are_half_way_to_their_limits():
    for name, faults in single_faults().items():
        [number] = [i for i, fault in enumerate(FAULTS) if fault.name == name]
        limit = FAULTS[number].limit
        assert limit is not None
        assert faults[number] == pytest.approx(FAULTS[number].healthy + 0.5 * limit)
        rest = present(faults) & (np.arange(len(FAULTS)) != number)
        assert not np.any(rest[: SHORT_CIRCUITS[-1] + 1])


def test_combinations_include_every_fault_and_short_only_one_phase():
    actuators = [combined_faults(number) for number in range(N_COMBINED)]
    assert np.all(np.any([present(k) for k in actuators], axis=0))
    for k in actuators:
        assert np.count_nonzero(k[SHORT_CIRCUITS]) == 1
    assert {np.sign(k[-1] - healthy_faults()[-1]) for k in actuators} == {-1.0, 1.0}


@pytest.fixture
def certificate() -> Certificate:
    faults = [FaultProspect(name, True, 0.004, 0.002, 0.01, ()) for name in COMPONENTS]
    nan = math.nan
    faults[BACKLASH] = FaultProspect("backlash", False, nan, nan, nan, (("load_torque",),))
    faults[0] = faults[0]._replace(error=0.02)
    causes = (
        CauseProspect("torque_constant", 0.05, Naming.NAMED),
        CauseProspect("load_torque", 0.3, Naming.HIDDEN),
        CauseProspect("inertia", 0.05, Naming.NAMED, (("gain",), ("friction", "backlash"))),
        CauseProspect("cogging", 0.01, Naming.NAMED, beside=("load_torque", "gain")),
        CauseProspect("stribeck", 0.1, Naming.NOT_SEPARATED, (("friction",),)),
        CauseProspect("supply_voltage", 0.1, Naming.MISTAKEN, beside=("load_torque", "gain")),
        CauseProspect("dead_time", 1e-6, Naming.REFUSED),
    )
    return Certificate("flap", "1", 0.01, 0.5, 1e-4, 0.02, nan, tuple(faults), causes)


def test_certificate_states_what_the_motion_does_not_show(certificate):
    text = str(certificate)
    assert "This motion does not show: backlash." in text
    assert "named: torque constant (5 %)" in text
    assert "does not show: load torque (0.3 N.m)" in text
    assert "named, not separated from gain, friction and backlash: inertia (5 %)" in text
    assert "named, with gain: cogging (0.01 N.m)" in text
    assert "not separated from friction: Stribeck friction (10 %)" in text
    assert "mistaken for load torque, gain: supply voltage (10 %)" in text
    assert "refused: dead time (1e-06 s)" in text
    assert "larger than their intervals for: friction." in text


def test_smallest_fault_is_reported_in_physical_units(certificate):
    meanings = {fault.name: fault.meaning for fault in certificate.faults}
    assert meanings["friction"] == "dry friction 1.020 × nominal"
    assert meanings["gain"] == "position-loop gain 1.010 × nominal or 0.990"
    assert meanings["backlash"] == ""


def test_wanted_sigma_that_is_not_reached_is_named(certificate):
    assert certificate.unmet({"friction": 0.01}) == []
    assert certificate.unmet({"friction": 0.003, "backlash": 0.1}) == [
        "friction has sigma 0.0040, expected 0.003 or less",
        "backlash is not shown, expected sigma 0.1 or less",
    ]


def test_record_has_plain_values_and_none_for_unknown_ones(certificate):
    record = certificate.record()
    assert record["faults"][BACKLASH]["sigma"] is None
    assert record["healthy_speed_rms"] is None
    assert record["faults"][0]["half_width"] == pytest.approx(HALF_WIDTH * 0.004)
    assert record["causes"][0] == {
        "name": "torque_constant",
        "size": 0.05,
        "naming": "named",
        "not_told_from": (),
        "beside": (),
        "meaning": "named",
    }
