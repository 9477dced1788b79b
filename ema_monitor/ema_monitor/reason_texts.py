# SPDX-License-Identifier: Apache-2.0
"""Sentences for reasons, in messages, tables and pages."""

import math
from collections.abc import Callable, Iterable
from typing import Any, Final

import ema_monitor.reasons as of
from ema_core.causes import CAUSE_BY_NAME, CauseEstimate
from ema_core.columns.errors import Reference
from ema_core.columns.wording import error_text, question
from ema_core.faults import FAULT_NAMES, SHORT_CIRCUITS
from ema_core.labels import label_of
from ema_core.wording import counted
from ema_monitor.quantities import QUANTITIES
from ema_monitor.reasons import Reason, Stage, StandstillCause, Unjudged, mistake_of

EQUAL_SHORTS: Final = tuple(FAULT_NAMES[phase] for phase in SHORT_CIRCUITS)
"""Names of the short circuits; if equal in all phases, they act like a smaller torque constant."""

EQUAL_SHORTS_LABEL: Final = "equal short circuits of all phases"
AND: Final = " and "

_FIGURES: Final = {
    "rest_current": "current at rest",
    **{
        f"{name}_{direction}": f"{label} in the {direction} stroke"
        for direction in ("forward", "backward")
        for name, label in (
            ("current", "current"),
            ("current_scatter", "scatter of the current"),
            ("current_roughness", "roughness of the current"),
            ("error_scatter", "scatter of the tracking error"),
            ("error_roughness", "roughness of the tracking error"),
        )
    },
    "friction_current": "mean current of both strokes",
}
"""Labels of the figures of a window, by name."""

_UNJUDGED: Final = {
    Unjudged.NO_GRAVITY: "the healthy records show no gravity",
    Unjudged.LITTLE_ACCELERATION: "the healthy records accelerate too little",
    Unjudged.ONE_SPEED: (
        "the healthy records have nearly one speed: it is part of Coulomb friction"
    ),
    Unjudged.ONLY_FRICTION: (
        "the healthy records show only friction, which cannot be distinguished from it"
    ),
    Unjudged.EFFORT_UNEXPLAINED: (
        "the motion does not explain a large part of the effort in the healthy records, which "
        "hides it"
    ),
    Unjudged.NO_SINGLE_CHANGE: (
        "it departs as well, and no single change explains the whole record"
    ),
    Unjudged.DOUBTFUL: (
        "the change is beyond usual variation, but not certain: repeat the record, or add healthy "
        "records from further days"
    ),
    Unjudged.HARDLY_VISIBLE: "friction or inertia is hardly visible in the record",
    Unjudged.NO_MOTOR_SIDE: (
        "it needs the speed of the motor, the position of the joint and several reversals"
    ),
    Unjudged.PLAY_INVISIBLE: (
        "no play is visible in the healthy records: both sensors are on one side, or a constant "
        "load closes the play"
    ),
    Unjudged.FEW_REVERSALS: "too few reversals, or no measured speed",
    Unjudged.PLAY_CLOSED: "a load closes the play",
    Unjudged.COMMAND_STILL: "the position command does not move enough",
    Unjudged.NO_COMMAND: "there is no position command",
    Unjudged.HEALTHY_COMMAND_STILL: (
        "the position command of the healthy records does not move enough"
    ),
    Unjudged.NO_HEALTHY_COMMAND: "the healthy records have no position command",
}
"""Reason why a quantity is not judged."""

_STOPPED: Final = {
    Stage.RECORD: "during the record",
    Stage.QUEUE: "before the window was identified",
    Stage.IDENTIFICATION: "during the identification",
}

_NO_STATE: Final = "no state is named"
_UNEXPLAINED: Final = "no fault explains it"
_MOST_NAMED: Final = 3
_LEAST_SHOWN: Final = 1e-6

_OPEN_CIRCUIT: Final = f"{label_of('dead_switch')} or {label_of('open_phase_a')}, B or C"


def text_of(reason: Reason) -> str:
    """Return the sentence of a reason, without a final full stop."""
    template = _TEXTS[type(reason)]
    text = template.format(r=reason) if isinstance(template, str) else template(reason)
    if not reason.of_stretches or isinstance(reason, of.CauseFound):
        return text
    return f"{text} ({_stretches(reason)})"


def joined(reasons: Iterable[Reason]) -> str:
    """Return the sentences for reasons, separated by semicolons."""
    return "; ".join(map(text_of, reasons))


def part_label(part: tuple[str, ...]) -> str:
    """Return the label of a part of an explanation: names of faults, or of a hidden cause."""
    return EQUAL_SHORTS_LABEL if part == EQUAL_SHORTS else AND.join(map(label_of, part))


def _stretches(reason: Reason) -> str:
    return f"in {reason.stretches} of {counted(reason.of_stretches, 'stretch')}"


def _cause(reason: Any) -> str:
    return str(CauseEstimate(reason.name, reason.value, reason.sigma))


def _cause_found(reason: of.CauseFound) -> str:
    if reason.of_stretches < 2:
        return _cause(reason)
    cause = CAUSE_BY_NAME[reason.name]
    scale, unit = (100.0, "%") if cause.unit == "-" else (1.0, cause.unit)
    span = f"{scale * reason.low:+.3g} to {scale * reason.high:+.3g} {unit}, "
    span = span if math.isfinite(reason.low) else ""
    return f"{_cause(reason)} ({span}{_stretches(reason)})"


def _not_measured(reason: of.NotMeasured) -> str:
    start = f"the {reason.column} is not measured"
    if reason.column == "current":
        return f"{start}: causes that the speed does not show are unknown"
    return f"{start}: the speed of the user shaft, derived from the position, is used instead"


def _columns(missing: tuple[str, ...]) -> str:
    return f"no {' and no '.join(missing)}" if missing else "all columns"


def _impossible_samples(reason: of.ImpossibleSamples) -> str:
    parts: list[str] = []
    if reason.jumps:
        parts.append(
            f"the position jumps {counted(reason.jumps, 'time')}, by up to "
            f"{reason.largest_jump:.4g} rad in {reason.period:g} s, and the motor can turn it by "
            f"{reason.possible_jump:.4g} rad"
        )
    if reason.spikes:
        parts.append(
            f"the speed is wrong for one sample {counted(reason.spikes, 'time')}, by up to "
            f"{reason.largest_spike:.4g} rad/s, and the motor can change it by "
            f"{reason.possible_spike:.4g} rad/s"
        )
    return f"impossible samples: {'; '.join(parts)}: repair the telemetry"


def _order_unknown(reason: of.OrderUnknown) -> str:
    contradiction = f"its stamp is {reason.before_s:.9g} s before the newest stamp"
    if reason.before_s <= 0.0:
        contradiction = "it differs from a test with the same stamp"
    return (
        f"the order of the tests is unknown: {contradiction}; set the clock of the actuator, "
        "or has_clock = false if it has no clock"
    )


def _run_too_short(reason: of.RunTooShort) -> str:
    lost = f" ({counted(reason.lost, 'sample')} lost)" if reason.lost else ""
    if reason.is_record:
        longest = f"{reason.longest * reason.period:.2g} s"
        pieces = f"at most {longest} without a gap{lost}" if lost else f"only {longest}"
        return f"a record needs {reason.length_s:g} s of motion, and the telemetry has {pieces}"
    return (
        f"a window of {reason.length_s:g} s has {reason.samples} samples after its start, and "
        f"there are never more than {reason.longest} samples without a gap{lost}"
    )


def _learning(reason: of.Learning) -> str:
    counts = counted(reason.records, "record")
    if reason.records:
        counts += f" on {counted(reason.days, 'day')}"
    parts = [f"learning: {counts}"]
    if math.isfinite(reason.other_day):
        same_day, other_day = (100.0 * share for share in (reason.same_day, reason.other_day))
        parts.append(
            f"changes of friction above {same_day:.2g} % would show, above {other_day:.2g} % on "
            "another day"
        )
    if reason.detail:
        parts.append(reason.detail)
    elif reason.records_needed:
        parts.append(f"the baseline is accepted with {reason.records_needed} records")
    else:
        parts.append("a person accepts the baseline")
    return "; ".join(parts)


def _stamps_contradict(reason: of.StampsContradict) -> str:
    bags = " and ".join(reason.bags)
    if reason.back_s > 0.0:
        back = f"the clock went back by {reason.back_s:.4g} s between two tests"
        return f"{bags}: {back}: their stamps must show which came first"
    hint = "`ema simulate --start` sets the date of simulated tests"
    if not reason.has_date:
        hint = f"specify the time of records with its date; {hint}"
    return (
        f"{bags}: different tests at the same time, {reason.end_s:.4f} s: their stamps must show "
        f"which came first; {hint}"
    )


def _other_unit(reason: of.OtherUnit) -> str:
    start = "forced although " if reason.forced else "the calibration does not fit: "
    return start + differences_text(reason.differences)


def differences_text(differences: Iterable[of.Difference]) -> str:
    """Return how an actuator differs from its calibration; empty without a difference."""
    return "; ".join(_difference(*difference) for difference in differences)


def _difference(name: str, actuator: str | float, calibration: str | float) -> str:
    if name == "drive" and calibration == "unknown":
        return (
            f"the actuator has drive = {actuator}, the calibration is of a unit whose controller "
            "is not modelled"
        )
    if name == "drive":
        return f"the actuator has drive {actuator!r}, the calibration is for {calibration!r}"
    if name == "serial_number":
        return (
            f"the actuator has serial number {actuator!r}, the calibration was made on "
            f"{calibration!r}: run `ema calibrate` for this unit"
        )
    if name == "acquisition":
        return f"the actuator has {actuator}, the calibration {calibration}"
    if name == "speed_measured":
        return "the speed is measured either in the telemetry or in the calibration, not in both"
    return f"the actuator has {name} = {actuator:g}, the calibration {calibration:g}"


def _columns_contradict(reason: of.ColumnsContradict) -> str:
    declared = f"({reason.acquisition})"
    parts = [
        f"the {name} is declared as measured {declared}, but its column is empty"
        for name in reason.empty
    ]
    parts += [
        f"the {name} is declared as not measured {declared}, but its column is filled"
        for name in reason.filled
    ]
    return "; ".join(parts)


def _not_separated(reason: of.NotSeparated) -> str:
    stand_ins = " or ".join(map(part_label, reason.stand_ins))
    return f"this {reason.subject} cannot separate {part_label(reason.part)} from {stand_ins}"


def _residual(reason: of.PoorFit | of.Unexplained) -> str:
    return (
        f"the residual is {reason.goodness:.1f} times the residual of a healthy actuator, at most "
        f"{reason.limit:.1f} is expected, and {100.0 * reason.unexplained_share:.0f} % of the "
        "departure from healthy is unexplained"
    )


def _faults_not_shown(reason: of.FaultsNotShown) -> str:
    return f"the motion does not show {', '.join(map(label_of, reason.faults))}"


def figure_text(figure: of.DepartedFigure) -> str:
    """Return how a figure differs from healthy."""
    label = figure_label(figure.name)
    if math.isnan(figure.value):
        return f"{label} is {figure.ratio:.3g} times the healthy value"
    share = f" ({100.0 * (figure.ratio - 1.0):+.0f} %)" if math.isfinite(figure.ratio) else ""
    return f"{label} is {figure.value:.3g} A, healthy {figure.healthy:.3g} A{share}"


def figure_label(name: str) -> str:
    """Return the label of a figure of a window, or of any other figure."""
    return _FIGURES.get(name) or label_of(name)


def _figures_departed(reason: of.FiguresDeparted) -> str:
    named = "; ".join(map(figure_text, reason.figures[:_MOST_NAMED]))
    return f"departed ({_rarity(reason.probability)} differs as much): {named}; {_UNEXPLAINED}"


def _rarity(probability: float) -> str:
    """Return a probability as "1 in ... healthy tests"."""
    least = max(probability, _LEAST_SHOWN)
    number = float(f"{1.0 / least:.2g}")
    return f"{'at most ' if probability < least else ''}1 in {number:,.0f} healthy tests"


def _labelled_state(reason: of.LabelledState) -> str:
    named = ", ".join(f"{state} ({100.0 * share:.0f} %)" for state, share in reason.probable)
    verb = "state is" if len(reason.probable) == 1 else "states are"
    return f"the most probable labelled {verb} {named}"


def _would_depart(reason: of.WouldDepart) -> str:
    change, smallest = f"{reason.change:+.3g} A", f"{reason.smallest_change:.3g} A"
    if reason.is_relative:
        change = f"{100.0 * reason.change:+.0f} %"
        smallest = f"{100.0 * reason.smallest_change:.0f} %"
    return (
        f"{figure_label(reason.figure)} differs by {change}; on a day without healthy tests, "
        f"changes above {smallest} would show"
    )


def _too_few_strokes(reason: of.TooFewStrokes) -> str:
    without = " without a payload" if reason.is_empty else ""
    return (
        f"{counted(reason.strokes, 'stroke')} {reason.way}{without}, at least {reason.least} in "
        f"each direction are needed: move back and forth{without}"
    )


def _speed_scaled(reason: of.SpeedScaled) -> str:
    fast = f"the {reason.column} changes {reason.factor:.3g} times as fast as in them"
    return f"{fast}: {question(reason.column, mistake_of(reason.mistake), Reference.RECORDS)}"


def _effort_scaled(reason: of.EffortScaled) -> str:
    asked = "a wrong unit or sign, or a failed sensor"
    if reason.mistake:
        asked = question("current", mistake_of(reason.mistake), Reference.RECORDS)
    return (
        f"the effort is {reason.factor:.3g} times the healthy effort: {asked}; compare the mapping "
        "with the mapping of the healthy records"
    )


def _joint_still(reason: of.JointStill) -> str:
    still = (
        f"the joint stands still although the command travels {reason.travel:.2g} "
        f"{reason.angle_unit}"
    )
    acting = f"{still} at an effort of {reason.effort:.2g} {reason.effort_unit}"
    if reason.cause is StandstillCause.NO_EFFORT:
        return (
            f"{acting}, and the healthy friction is {reason.friction:.2g} {reason.effort_unit}: is "
            "the drive off, a brake applied or a phase open?"
        )
    if reason.cause is StandstillCause.SHORT_COMMAND:
        least = f"{reason.least_travel:.2g} {reason.angle_unit}"
        return f"{still}: command at least {least}, as the healthy records do"
    return f"{acting}: a blocked shaft, an open phase or a frozen sensor"


def _other_zero(reason: of.OtherZero) -> str:
    return (
        "Or the zero of the position has moved: the record agrees better if the position is "
        f"{abs(reason.shift):.2f} rad {'more' if reason.shift > 0.0 else 'less'} than in the "
        "healthy records: check the homing"
    )


def _effort_shifted(reason: of.EffortShifted) -> str:
    way = "later" if reason.shift_s > 0.0 else "earlier"
    return (
        f"The effort is {1e3 * abs(reason.shift_s):.0f} ms {way} than in the healthy records, "
        "which is corrected: check whether filter, driver or clock of the effort have changed"
    )


def _spikes_removed(reason: of.SpikesRemoved) -> str:
    return (
        f"The effort has {counted(reason.spikes, 'spike')} in {reason.samples} samples, which "
        f"{'is' if reason.spikes == 1 else 'are'} ignored: check sensor and bus"
    )


def _other_updates(reason: of.OtherUpdates) -> str:
    return (
        f"the position is updated every {reason.samples:.1f} samples on average, in the healthy "
        f"records every {reason.healthy:.1f}: roughness and scatter cannot be compared; configure "
        "the driver to publish each position once"
    )


def _samples_interpolated(reason: of.SamplesInterpolated) -> str:
    return f"{counted(reason.interpolated, 'lost sample')} of {reason.samples} interpolated"


_TEXTS: Final[dict[type[Reason], str | Callable[[Any], str]]] = {
    of.SamplesLost: lambda r: (
        f"gap of {counted(r.index - r.expected, 'sample')}: index {r.index} follows "
        f"{r.expected - 1}"
    ),
    of.IndexWentBack: "the sample index went back from {r.latest} to {r.index}",
    of.TimeWentBack: "time ran backwards by {r.back_s:g} s at index {r.index}",
    of.PeriodChanged: "the sample period changed from {r.before:g} s to {r.period:g} s",
    of.ColumnsChanged: lambda r: (
        f"{_columns(r.missing)} measured from index {r.index} on, "
        f"{_columns(r.missing_before)} before"
    ),
    of.PayloadChanged: lambda r: (
        f"the payload is only known {'from' if r.is_known else 'before'} index {r.index}"
    ),
    of.StampsOffPeriod: (
        "the stamps give one sample every {r.stamped:.4g} s, the blocks {r.period:.4g} s"
    ),
    of.OtherPeriod: (
        "the description gives one sample every {r.described:g} s, the telemetry {r.period:g} s, "
        "which is used"
    ),
    of.SamplesNotFinite: lambda r: (
        f"{r.column} is {r.value} at index {r.index} ({r.samples} such samples in its block): "
        f"expected {'finite numbers' if math.isnan(r.largest) else f'numbers below {r.largest:g}'}"
    ),
    of.ImpossibleSamples: _impossible_samples,
    of.TooManySamples: lambda r: (
        f"sample_period = {r.period:g} s: a {'record' if r.is_record else 'window'} of "
        f"{r.length_s:g} s would have {r.samples:,} samples, expected at most {r.most:,}"
    ),
    of.TooManyBlocks: "the window has more than {r.most:,} blocks",
    of.TelemetryEnded: ("the telemetry ends {r.after_s:.3f} s into the window of {r.window_s:g} s"),
    of.MalformedBlock: "{r.error}",
    of.DescriptionChanged: "the description of the actuator changed",
    of.SettingsChanged: "the settings of the window changed",
    of.MonitorStopped: lambda r: f"the monitor was stopped {_STOPPED[r.stage]}",
    of.MonitorInactive: "the monitor is not active",
    of.QueueFull: lambda r: (
        f"dropped: more than {counted(r.most, 'stretch' if r.is_stretch else 'window')} waited for "
        "identification"
    ),
    of.IdentificationFailed: "{r.error}",
    of.OrderUnknown: _order_unknown,
    of.StampsContradict: _stamps_contradict,
    of.NotMeasured: _not_measured,
    of.FitnessNeedsCurrent: (
        "the current is not measured: fitness {r.fitness} compares currents only, use {r.usable}"
    ),
    of.EffortMissing: (
        "the joint cannot be judged: no effort (current or torque) is measured; map a topic or "
        "column that has one"
    ),
    of.PayloadMissing: (
        "the payload is not in the telemetry: only motion without a payload can be compared with "
        "the healthy records; publish or record it again"
    ),
    of.SpeedGaps: ("the speed is missing in some samples: omit these samples, or the whole column"),
    of.NoTravel: (
        "no excitation: the command travels {r.travel:.3g} rad, expected at least {r.least:g} rad"
    ),
    of.MotorStill: "no excitation: the motor stands still although the command moves",
    of.NotDetermined: ("no excitation: the {r.subject} determines no fault better than its range"),
    of.CommandMissing: (
        "windows are cut by the position command, and the telemetry has no command: map it, or "
        "describe the drive as unknown, which needs no command"
    ),
    of.RunTooShort: _run_too_short,
    of.PieceTooShort: (
        "a record needs {r.least_s:g} s of motion, and the longest piece has {r.longest_s:.2g} s"
    ),
    of.TravelTooSmall: (
        "a record needs a travel of {r.least:.2g} rad, and the position travels {r.travel:.2g} rad"
    ),
    of.CommandTravelTooSmall: (
        "window_s = {r.window_s:g} s: the command never travels {r.least:g} rad within it"
    ),
    of.MotionTooShort: (
        "window_s = {r.window_s:g} s: the longest motion after a rest of {r.rest_s:g} s lasts "
        "{r.longest_s:.3g} s"
    ),
    of.NeverAtRest: (
        "rest_s = {r.rest_s:g} s, threshold = {r.threshold:g} rad: the command was never at rest "
        "in {r.seen_s:.0f} s"
    ),
    of.NoCalibration: (
        "there is no calibration yet: {r.file} is missing; calibrate on the healthy unit"
    ),
    of.CalibrationUnusable: "the calibration cannot be used: {r.error}",
    of.BaselineUnusable: "the baseline cannot be used: {r.error}",
    of.Learning: _learning,
    of.DriveUnknown: (
        "drive = unknown, but the calibration is of a known drive; calibrate on healthy motion of "
        "this unit"
    ),
    of.OtherUnit: _other_unit,
    of.OtherSamples: (
        "the sample period is {r.period:g} s, in the calibration of {r.unit[0]} ({r.unit[1]}) "
        "{r.calibrated:g} s"
    ),
    of.PeriodTooLong: (
        "the sample period is {r.period:g} s, at most {r.longest:.3g} s can be compared with the "
        "healthy records: record at a higher rate, or calibrate at this one"
    ),
    of.ColumnsContradict: _columns_contradict,
    of.Jam: (
        f"{label_of('jam')}: the motor stands still although {{r.current:.1f}} A flow; the shaft "
        "is blocked"
    ),
    of.OpenCircuit: (
        f"{_OPEN_CIRCUIT}: the motor stands still, and of the {{r.wanted:.1f}} A that the speed "
        "loop wants {r.current:.1f} A flow"
    ),
    of.JamOrOpenCircuit: (
        f"{label_of('jam')}, {_OPEN_CIRCUIT}: the motor stands still although the speed loop wants "
        "{r.wanted:.1f} A; the current, which would distinguish them, is not measured"
    ),
    of.DeadSensor: (
        "dead {r.column} sensor: its value is {r.value:.3g} throughout, although the {r.moving} "
        "changes"
    ),
    of.WrongScale: lambda r: error_text(r.error),
    of.NoFiniteCost: "no fault vector has a finite cost",
    of.UncertaintyUnknown: "the uncertainty cannot be computed: {r.error}",
    of.NotConverged: "the search was stopped before it converged",
    of.Contradicted: lambda r: f"not used, as the {r.subject} contradicts it: measured {_cause(r)}",
    of.CauseFound: _cause_found,
    of.SensorBeyondRange: lambda r: f"a sensor error is too large to be corrected: {_cause(r)}",
    of.NotSeparated: _not_separated,
    of.FitUnjudged: (
        "standard deviations are widened: the fit cannot be judged, because the healthy windows of "
        "the calibration ({r.calibration_windows}) do not show their scatter: calibrate with "
        "several different windows"
    ),
    of.PoorFit: lambda r: f"standard deviations are widened: {_residual(r)}",
    of.Unexplained: lambda r: (
        f"neither faults nor known causes explain the {r.subject}: {_residual(r)}"
    ),
    of.MotionEnded: "the motion ended",
    of.MotionDisagrees: "the subsequent motion does not agree with the estimate",
    of.FaultsNotShown: _faults_not_shown,
    of.StretchesInsufficient: "the stretches do not determine the faults to the wanted accuracy",
    of.StatedReason: "{r.sentence}",
    of.FiguresDeparted: _figures_departed,
    of.LabelledState: _labelled_state,
    of.OtherMotion: lambda r: (
        f"{_NO_STATE}: no healthy window has the motion {r.travel:.3g} rad at {r.speed:.3g} rad/s, "
        f"{1.0 / r.sample_period:g} Hz"
    ),
    of.OtherLoad: (
        f"{_NO_STATE}: the load is new, {{r.away:.2g}} A from the healthy and labelled windows"
    ),
    of.TooFewHealthy: f"{_NO_STATE}: the load has fewer than {{r.least}} healthy windows",
    of.TooFewLabelled: (
        f"{_NO_STATE}: no labelled state has {{r.least}} tests of this motion and load"
    ),
    of.WouldDepart: _would_depart,
    of.QuantityUnjudged: lambda r: _UNJUDGED[r.cause],
    of.QuantityInseparable: lambda r: (
        "this motion cannot distinguish it from "
        + AND.join(QUANTITIES[name].label for name in r.changed)
    ),
    of.TooFewRows: (
        "{r.rows} rows of steady motion in one direction, at least {r.least} are needed: "
        "record a longer motion, without gaps of lost samples"
    ),
    of.EffortConstant: (
        "the effort is {r.effort:.3g} throughout, although the joint moves: expected an effort "
        "that follows the motion; look for a failed sensor, or a wrong column in the mapping"
    ),
    of.TooFewStrokes: _too_few_strokes,
    of.SpeedOutside: (
        "the speed is {r.ratio:.2g} times the speed of the healthy records, expected "
        "{r.slowest:g} to {r.fastest:g} times: add healthy records of this motion"
    ),
    of.SpeedScaled: _speed_scaled,
    of.EffortScaled: _effort_scaled,
    of.NegativeQuantity: (
        "the {r.name} is {r.ratio:.2g} times the healthy {r.name}, expected above 0: is the effort "
        "delayed by more than 0.1 s, of opposite sign, or of another joint? Compare mapping and "
        "clocks with the healthy records"
    ),
    of.EffortReversed: (
        "the effort has the opposite sign of the healthy records, or belongs to another joint: "
        "compare the mapping with the mapping of the healthy records"
    ),
    of.JointStill: _joint_still,
    of.OtherZero: _other_zero,
    of.EffortShifted: _effort_shifted,
    of.SpikesRemoved: _spikes_removed,
    of.OtherUpdates: _other_updates,
    of.SamplesInterpolated: _samples_interpolated,
}
"""Template or function for each kind."""
