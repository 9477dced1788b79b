# SPDX-License-Identifier: Apache-2.0
"""The comparison of a record survives serialisation without loss."""

from dataclasses import replace

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from tests.monitor.comparisons import CASES, END_NS, compared
from tests.monitor.windows import estimated

from ema_bags.telemetry import ESTIMATE_TYPE
from ema_cli.bags.diagnoses import DiagnosisLog
from ema_core.description import ActuatorDescription
from ema_interfaces.msg import FaultEstimate, QuantityChange, UnitTest
from ema_monitor.joint.comparison import JUDGEMENTS, Judgement, not_judged
from ema_monitor.node.publish.messages import estimate_to_message, fault_bits, unknown_estimate
from ema_monitor.reasons import QuantityUnjudged, StatedReason, TooFewRows, Unjudged

UNIT = ActuatorDescription()


def received(name: str) -> FaultEstimate:
    message = estimate_to_message(compared(CASES[name]), 3, UNIT)
    return deserialize_message(serialize_message(message), FaultEstimate)


@pytest.mark.parametrize("name", CASES)
def test_quantities_survive_the_wire(name: str):
    log = DiagnosisLog()
    log.add(ESTIMATE_TYPE, received(name), END_NS)
    [diagnosis] = log.diagnoses()
    # A message has the sentence and the codes of the reasons.
    sent = [
        replace(item, reasons=(StatedReason(item.reason),) if item.reason else ())
        for item in CASES[name].quantities
    ]
    # NaN differs from NaN, but their texts are equal.
    assert repr(diagnosis.quantities) == repr(tuple(sent))


def test_quantity_has_the_codes_of_its_reasons():
    unjudged = QuantityUnjudged(Unjudged.DOUBTFUL)
    reasons = unjudged, TooFewRows(3, 5), QuantityUnjudged(Unjudged.ONE_SPEED)
    sent = compared(not_judged(*reasons))
    for quantity in estimate_to_message(sent, 3, UNIT).quantities:
        assert quantity.reason_codes == ["quantity_unjudged", "too_few_rows"]
    for quantity in received("friction").quantities:
        assert not quantity.reason_codes or quantity.judgement == QuantityChange.NOT_JUDGED


def test_judgements_have_the_constants_of_the_message():
    by_name = {
        Judgement.UNCHANGED: QuantityChange.UNCHANGED,
        Judgement.CHANGED: QuantityChange.CHANGED,
        Judgement.NOT_JUDGED: QuantityChange.NOT_JUDGED,
    }
    assert {judgement: JUDGEMENTS.index(judgement) for judgement in Judgement} == by_name
    assert QuantityChange().judgement == QuantityChange.NOT_JUDGED


def test_estimate_of_a_modelled_drive_has_no_quantities():
    assert list(estimate_to_message(estimated(), 0, UNIT).quantities) == []
    assert list(unknown_estimate("flap", "no window").quantities) == []


def test_unknown_judgement_is_refused():
    message = received("friction")
    first, *rest = message.quantities
    first.judgement = 7
    message.quantities = [first, *rest]
    with pytest.raises(ValueError, match=r"quantities: judgement = 7, expected 0, 1 or 2"):
        DiagnosisLog().add(ESTIMATE_TYPE, message, END_NS)


@pytest.mark.parametrize("message", [FaultEstimate, UnitTest])
def test_ninth_fault_in_one_byte_is_refused(message: type):
    """A ninth fault in one byte would be published as observable and significant."""
    last = np.arange(8) == 7
    assert fault_bits(message, "insignificant", last) == FaultEstimate.GAIN
    with pytest.raises(
        ValueError, match=rf"{message.__name__}.insignificant is uint8: .* 9 faults"
    ):
        fault_bits(message, "insignificant", np.arange(9) == 8)
