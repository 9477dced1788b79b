# SPDX-License-Identifier: Apache-2.0
"""Parts of an explanation are compared by name; labels are added when they are shown."""

from ema_monitor.design.rehearsal import confused_with, fewest
from ema_monitor.identification.alternatives import Alternative, faults_of, names_of
from ema_monitor.identification.estimate import Estimate
from ema_monitor.reason_texts import EQUAL_SHORTS, part_label


def estimate(*alternatives: Alternative) -> Estimate:
    return Estimate(0, 1, "a", 0, "c", alternatives=alternatives)


def test_fault_does_not_get_the_confusions_of_a_cause_with_a_similar_name():
    result = estimate(
        Alternative(("viscous_friction",), ("load_torque",)),
        Alternative(("current_gain",), ("inertia",)),
        Alternative(("friction",), ("stribeck",)),
    )
    assert confused_with(result, "friction") == {("stribeck",)}
    assert confused_with(result, "gain") == set()
    assert confused_with(result, "inertia") == {("current_gain",)}


def test_each_of_several_shorts_gets_the_confusions_of_all():
    result = estimate(Alternative(("torque_constant",), EQUAL_SHORTS))
    for name in EQUAL_SHORTS:
        assert confused_with(result, name) == {("torque_constant",)}
    assert faults_of([EQUAL_SHORTS, ("inertia",)]) == [2, 3, 4]
    assert names_of(result.alternatives) == {"torque_constant", *EQUAL_SHORTS}


def test_parts_that_are_all_listed_separately_are_left_out():
    pair = EQUAL_SHORTS[:2]
    assert fewest([pair, *((name,) for name in pair)]) == tuple((name,) for name in pair)
    assert fewest([pair, pair[:1]]) == (pair[:1], pair)


def test_labels_name_several_faults_and_equal_shorts():
    assert part_label(EQUAL_SHORTS) == "equal short circuits of all phases"
    assert part_label(EQUAL_SHORTS[:2]) == "short circuit A and short circuit B"
    assert part_label(("command_delay",)) == "delay of the command"
